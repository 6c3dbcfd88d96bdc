"""What tests need to know of operating systems."""

NOT_ON_WINDOWS = ["utils/test_signals.py", "robustness/test_ends.py"]
"""Modules that name signals which Windows lacks when they are imported."""
