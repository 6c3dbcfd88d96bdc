"""The experiments: their settings, their runs, and what is observed in them."""
