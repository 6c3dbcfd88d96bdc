"""What tests need to know of operating systems."""

import os

import pytest

NOT_ON_WINDOWS = ["utils/test_signals.py", "robustness/test_ends.py"]
"""Modules that name signals which Windows lacks when they are imported."""
needs_named_pipes = pytest.mark.skipif(
    not hasattr(os, "mkfifo"), reason="Windows has no pipes among its files"
)
