"""Tasks of swarms: their base class, cleaning and other tasks."""
