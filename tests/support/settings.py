"""Settings that are refused."""

from contextlib import contextmanager

import pytest

from iswarm_mj.utils.errors import ConfigError


@contextmanager
def refused_setting(name, value, constraint=""):
    """Assert that the block refuses a setting.

    Args:
        name: name of the setting, such as `arena.size`.
        value: value that is refused.
        constraint: words of what must hold.
    """
    with pytest.raises(ConfigError) as refused:
        yield
    error = refused.value
    assert error.field == name
    assert error.value == value
    assert constraint in error.constraint
