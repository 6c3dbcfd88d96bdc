"""The bench: one ball between plate and probe, in several engines."""
