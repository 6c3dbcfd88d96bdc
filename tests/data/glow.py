"""Aggregation under another name, as a user's file offers it."""

from iswarm_mj.tasks.aggregation import Aggregation


class Glow(Aggregation):
    """Two spots of light."""
