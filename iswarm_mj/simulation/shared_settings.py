"""Settings that all worlds of one run share, and those in which they may differ."""

from dataclasses import fields, replace
from typing import Any

from iswarm_mj.config.static import StaticConfig
from iswarm_mj.config.swarm import SwarmConfig
from iswarm_mj.gripper.tips.table import time_of_change
from iswarm_mj.utils.errors import UserError

_CONFIG_PARTS: dict[str, Any] = {f.name: f.type for f in fields(SwarmConfig)}
_STATIC_PARTS: dict[str, Any] = {f.name: f.type for f in fields(StaticConfig)}

_SHARED_OF_ARENA = {"size", "outline", "n_dust", "obstacles", "boxes"}
"""Settings of the arena that engines build their models from, or that shape the state of a task."""


def _per_world(part: str) -> set[str]:
    """Return the settings of a part of the configuration in which worlds may differ."""
    names = {f.name for f in fields(_CONFIG_PARTS[part])}
    if part == "arena":
        return names - _SHARED_OF_ARENA
    return names - {f.name for f in fields(_STATIC_PARTS[part])}


PER_WORLD_FIELDS = {part: _per_world(part) for part in _CONFIG_PARTS}
"""Settings in which worlds of one run may differ, by parts of the configuration."""


def shared_settings(config: SwarmConfig) -> tuple[tuple[str, Any], ...]:
    """Return names and values of the settings that all worlds of a run share."""
    return tuple(
        (f"{part}.{f.name}", getattr(settings, f.name))
        for part, settings in vars(config).items()
        for f in fields(settings)
        if f.name not in PER_WORLD_FIELDS[part]
    )


def check_shared_settings(config: SwarmConfig, of_world: SwarmConfig) -> None:
    """Check that a world differs from its run only in settings in which worlds may differ.

    Args:
        config: configuration of the run.
        of_world: configuration of the world.

    Raises:
        UserError: the world differs in another setting.
    """
    of_run = dict(shared_settings(config))
    differing = [name for name, value in shared_settings(of_world) if value != of_run[name]]
    if differing:
        raise UserError(
            f"a world differs from its run in {' and '.join(differing)}, which all worlds of one "
            "run share; run it separately."
        )


def static_config(config: SwarmConfig, *, on_host: bool) -> StaticConfig:
    """Return the settings that the control steps of a run are compiled for.

    Args:
        config: configuration of the run.
        on_host: the engine computes on the host, where trials run in MuJoCo in C unless their place
            is chosen.
    """
    static = config.static
    tip = static.gripper.tip
    if tip is not None:
        static = replace(static, tip_changed=time_of_change(tip))
    if static.gripper.bench != "auto":
        return static
    bench = "c" if on_host else "mjx"
    return replace(static, gripper=replace(static.gripper, bench=bench))
