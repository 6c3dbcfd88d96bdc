"""Configurations with other values, by the names of the settings."""

from collections.abc import Mapping
from dataclasses import replace
from itertools import groupby
from typing import Any

from iswarm_mj.config import SwarmConfig

Values = Mapping[str, Any]
"""Settings by names such as optics.mode."""


def varied(config: SwarmConfig, values: Values) -> SwarmConfig:
    """Configuration with these values; those of one part are changed at once, since they may depend on each other."""
    parts = {}
    for part, names in groupby(sorted(values), key=lambda name: name.partition(".")[0]):
        parts[part] = replace(getattr(config, part), **{name.partition(".")[2]: values[name] for name in names})
    return replace(config, **parts)
