"""A run that is there before commands begin."""

import pytest
from support.long_commands import EarlierRun


@pytest.fixture(scope="module")
def earlier(tmp_path_factory):
    """A complete run of an earlier time."""
    return EarlierRun(tmp_path_factory.mktemp("earlier"))
