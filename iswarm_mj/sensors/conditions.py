"""Noise, voltages and places of a world: what may differ between worlds of one run, beside the robots' rules."""

from collections import namedtuple

from iswarm_mj.config import SwarmConfig
from iswarm_mj.utils.constraints import per_world

_PLACES = {name: part for part, group in vars(SwarmConfig()).items() for name in per_world(type(group))}

Conditions = namedtuple("Conditions", list(_PLACES))
"""What the surroundings of one world are like, as scalars, or of B worlds, as arrays (B,): all settings that the
configuration annotates `PER_WORLD`, by their names."""


def conditions_of(config: SwarmConfig) -> Conditions:
    """Return the conditions that a configuration sets, as floats and Booleans."""
    return Conditions(*(getattr(getattr(config, part), name) for name, part in _PLACES.items()))
