"""The report on all results."""
