"""Statistics, findings and their figures."""
