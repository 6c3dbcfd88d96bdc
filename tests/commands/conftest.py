"""Commands run in an empty working directory."""

import pytest


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch):
    """Return the working directory, which is empty."""
    monkeypatch.chdir(tmp_path)
    return tmp_path
