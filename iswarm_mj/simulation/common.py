"""What the worlds of one run have in common, and in which settings they may differ."""

from dataclasses import fields, replace
from typing import Any

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


def shared(config: SwarmConfig) -> tuple[tuple[str, Any], ...]:
    """Return names and values of the settings that all worlds of a run share."""
    return tuple(
        (f"{part}.{f.name}", getattr(mine, f.name))
        for part, mine in vars(config).items()
        for f in fields(mine)
        if f.name not in PER_WORLD_FIELDS[part]
    )


def common(config: SwarmConfig) -> SwarmConfig:
    """Return what control steps are compiled for: the defaults of all that may differ, and of the arena."""
    usual = SwarmConfig()
    parts = {
        part: replace(mine, **{name: getattr(getattr(usual, part), name) for name in PER_WORLD_FIELDS[part]})
        for part, mine in vars(config).items()
        if part != "arena"
    }
    return SwarmConfig(ArenaConfig(), **parts)


def program_config(config: SwarmConfig, task: Task, on_host: bool) -> SwarmConfig:
    """Return the configuration that control steps are compiled for.

    Where the task allows it, what may differ between worlds of one run and the arena have their defaults, so that runs
    of different settings share a program.

    Args:
        config: of the run.
        task: see `tasks.protocol.Task`.
        on_host: the engine computes on the host, where the bench is that of MuJoCo in C unless it is chosen.
    """
    config = common(config) if getattr(task, "shares_program", False) else config
    if config.gripper.bench != "auto":
        return config
    return replace(config, gripper=replace(config.gripper, bench="c" if on_host else "mjx"))


def check_common(config: SwarmConfig, other: SwarmConfig) -> None:
    """Raise a UserError if a world's configuration differs from its run's in what all worlds of a run share."""
    pairs = zip(shared(config), shared(other), strict=True)
    if differ := [name for (name, value), (_, its) in pairs if value != its]:
        raise UserError(
            f"a world differs from its run in {' and '.join(differ)}, which all worlds of one run share; "
            "run it separately."
        )
