"""What the worlds of one run have in common, and in which settings they may differ."""

from dataclasses import fields, replace
from typing import Any

from iswarm_mj.config.static import StaticConfig
from iswarm_mj.config.swarm import SwarmConfig
from iswarm_mj.utils.errors import UserError

_PARTS: dict[str, Any] = {f.name: f.type for f in fields(SwarmConfig)}
_STATIC: dict[str, Any] = {f.name: f.type for f in fields(StaticConfig)}
_SHARED_BY_ENGINES = {"size", "outline", "n_dust", "obstacles", "boxes"}
"""Settings of the arena that engines build their models from, or that shape the state of a task."""


def _per_world(part: str) -> set[str]:
    """Return the settings of a part of the configuration in which worlds may differ."""
    compiled = _SHARED_BY_ENGINES if part == "arena" else {f.name for f in fields(_STATIC[part])}
    return {f.name for f in fields(_PARTS[part])} - compiled


PER_WORLD_FIELDS = {part: _per_world(part) for part in _PARTS}
"""Settings in which worlds of one run may differ, by parts of the configuration."""


def shared_settings(config: SwarmConfig) -> tuple[tuple[str, Any], ...]:
    """Return names and values of the settings that all worlds of a run share."""
    return tuple(
        (f"{part}.{f.name}", getattr(mine, f.name))
        for part, mine in vars(config).items()
        for f in fields(mine)
        if f.name not in PER_WORLD_FIELDS[part]
    )


def static_config(config: SwarmConfig, on_host: bool) -> StaticConfig:
    """Return what the control steps of a run are compiled for.

    Args:
        config: of the run.
        on_host: the engine computes on the host, where the bench is that of MuJoCo in C unless it is chosen.
    """
    static = config.static
    if static.gripper.bench != "auto":
        return static
    return replace(static, gripper=replace(static.gripper, bench="c" if on_host else "mjx"))


def check_shared_settings(config: SwarmConfig, other: SwarmConfig) -> None:
    """Raise a UserError if a world's configuration differs from its run's in what all worlds of a run share."""
    pairs = zip(shared_settings(config), shared_settings(other), strict=True)
    if differ := [name for (name, value), (_, its) in pairs if value != its]:
        raise UserError(
            f"a world differs from its run in {' and '.join(differ)}, which all worlds of one run share; "
            "run it separately."
        )
