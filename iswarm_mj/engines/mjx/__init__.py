"""MJX: batches of worlds in compiled programs."""
