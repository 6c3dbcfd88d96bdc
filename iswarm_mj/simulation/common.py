"""What the worlds of one run have in common, and in which settings they may differ."""

from dataclasses import fields, replace
from typing import Any, NamedTuple

from iswarm_mj.config import ArenaConfig, SwarmConfig
from iswarm_mj.sensors.conditions import Conditions
from iswarm_mj.strategy.rules import NON_STRATEGY_FIELDS
from iswarm_mj.tasks.protocol import Task
from iswarm_mj.utils.errors import UserError

_PARTS: dict[str, Any] = {f.name: f.type for f in fields(SwarmConfig)}
_SHARED = {
    "arena": {"size", "outline", "n_dust", "obstacles", "boxes"},
    "gripper": {
        *("release_gap", "tool_reach", "resolution", "bench", "bench_capacity", "tool_error"),
        *("grasp_time", "release_time"),
    },
    "strategy": NON_STRATEGY_FIELDS - set(Conditions._fields),
}
"""Of these parts, all other settings may differ; of the remaining ones, those that are `Conditions`."""

PER_WORLD_FIELDS = {
    part: {
        f.name
        for f in fields(cls)
        if (f.name not in _SHARED[part] if part in _SHARED else f.name in Conditions._fields)
    }
    for part, cls in _PARTS.items()
}
"""Settings in which worlds of one run may differ, by parts of the configuration."""


class Common(NamedTuple):
    """What worlds of one run have in common."""

    config: SwarmConfig
    """With the defaults of all that may differ, and of the arena: what control steps are compiled for."""
    corners: tuple[tuple[float, float], ...]
    """Of the arena [rd]."""
    n_dust: int
    """Balls."""
    standing: tuple[tuple[float, ...], ...]
    """Obstacles and boxes in the arena."""


def common(config: SwarmConfig) -> Common:
    """Return what a world of this configuration has in common with others of the same run."""
    usual = SwarmConfig()
    parts = {
        part: replace(mine, **{name: getattr(getattr(usual, part), name) for name in PER_WORLD_FIELDS[part]})
        for part, mine in vars(config).items()
        if part != "arena"
    }
    return Common(SwarmConfig(ArenaConfig(), **parts), config.arena.corners, config.arena.n_dust, config.arena.standing)


def program_config(config: SwarmConfig, task: Task, on_host: bool) -> SwarmConfig:
    """Return the configuration that control steps are compiled for.

    Where the task allows it, what may differ between worlds of one run and the arena have their defaults, so that runs
    of different settings share a program.

    Args:
        config: of the run.
        task: see `tasks.protocol.Task`.
        on_host: the engine computes on the host, where the bench is that of MuJoCo in C unless it is chosen.
    """
    config = common(config).config if getattr(task, "shares_program", False) else config
    if config.gripper.bench != "auto":
        return config
    return replace(config, gripper=replace(config.gripper, bench="c" if on_host else "mjx"))


def check_common(config: SwarmConfig, other: SwarmConfig) -> None:
    """Raise a UserError if a world's configuration differs from its run's in what all worlds of a run share."""
    if common(config) == common(other):
        return
    differ = [
        f"{part}.{f.name}"
        for part, cls in _PARTS.items()
        for f in fields(cls)
        if f.name not in PER_WORLD_FIELDS[part]
        and getattr(getattr(config, part), f.name) != getattr(getattr(other, part), f.name)
    ]
    raise UserError(
        f"a world differs from its run in {' and '.join(differ)}, which all worlds of one run share; run it separately."
    )
