"""Worlds of a batch: what each is, and the arrays that a batched run begins with."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from iswarm_mj.config import Conditions, GripperConfig, OpticsConfig, SwarmConfig, conditions_of
from iswarm_mj.simulation.run_mujoco import RunSettings, Start, draw_start
from iswarm_mj.strategy.controller import rules_of
from iswarm_mj.strategy.genome import Genome
from iswarm_mj.strategy.protocol import Strategy
from iswarm_mj.strategy.vector_strategy import VectorStrategy
from iswarm_mj.utils.arrays import Array
from iswarm_mj.utils.errors import UserError

_NOISE = {"error_distance_measure", "error_in_communication", "p_communication_break"}
_COMPILED_IN = {"release_gap", "tool_reach"}


@dataclass(frozen=True)
class World:
    """One world of a batch; what is not given is as in the batch's configuration."""

    genome: Genome
    """The paper's strategy with these parameters (Table 2); does not count where the batch is given another."""
    n_robots: int
    """Robots in this world, at most those of the batch."""
    seed: int = 0
    """Seed of the world's random numbers."""
    index: int = 0
    """Number of the world under its seed: the same world as world `index` of a run of this seed."""
    failed_fraction: float = 0.0
    """Share of the robots that are dead from the start."""
    optics: OpticsConfig | None = None
    """May differ in its noise."""
    gripper: GripperConfig | None = None
    """May differ in all but gap and reach: humidity, works of adhesion, voltages, drop rate."""
    start: Start | None = None
    """How the world begins; drawn by its seed if not given."""
    key: Array | None = None
    """Random key of what happens then; by seed and index if not given."""

    @property
    def random_key(self) -> Array:
        """Key of the world's noise and of its robots' chances."""
        return jax.random.fold_in(jax.random.key(self.seed), self.index) if self.key is None else self.key


class Given(NamedTuple):
    """What stays the same in one world during a run."""

    strategy: Strategy
    conditions: Conditions
    key: Array
    """Random key."""
    is_present: Array
    """(N,) bool; the others are not there."""
    goal: Array
    """Finished when this many balls are delivered."""


def vector_strategies(config: SwarmConfig, probe_reach: float, worlds: Sequence[World]) -> VectorStrategy:
    """Return the paper's strategy with the genome of each world, stacked along a first axis."""
    each = [
        VectorStrategy(
            rules_of(w.genome), jnp.asarray(round(w.genome.fraction_scouts * w.n_robots)), config, probe_reach
        )
        for w in worlds
    ]
    return stacked(each)


def starts_of(config: SwarmConfig, worlds: Sequence[World]) -> list[Start]:
    """Return how each world begins.

    Raises:
        UserError: a world differs in what all worlds of a batch share.
    """
    return [_start(config, w) for w in worlds]


def conditions_of_all(config: SwarmConfig, worlds: Sequence[World]) -> Conditions:
    """Return the noise and the voltages of each world, stacked."""
    each = [conditions_of(_config(config, w)) for w in worlds]
    return jax.tree.map(lambda *values: jnp.asarray(values, jnp.float32), *each)


def padded(start: Start, n_robots: int) -> Start:
    """A start with as many robots as the batch has; those added are dead."""
    more = n_robots - len(start.poses)
    return Start(np.pad(start.poses, ((0, more), (0, 0))), start.balls, np.pad(np.asarray(start.is_alive), (0, more)))


def stacked(trees: Sequence[Any]) -> Any:
    """Trees of arrays with a new first axis."""
    return jax.tree.map(lambda *leaves: jnp.stack([jnp.asarray(leaf) for leaf in leaves]), *trees)


def _config(config: SwarmConfig, world: World) -> SwarmConfig:
    return replace(config, optics=world.optics or config.optics, gripper=world.gripper or config.gripper)


def _start(config: SwarmConfig, world: World) -> Start:
    own = _config(config, world)
    quiet = {name: 0.0 for name in _NOISE}
    gap = {name: getattr(config.gripper, name) for name in _COMPILED_IN}
    if replace(own.optics, **quiet) != replace(config.optics, **quiet) or replace(own.gripper, **gap) != own.gripper:
        shared = ", ".join(sorted(_COMPILED_IN))
        raise UserError(
            f"A world has other optics than its batch, or another {shared} of its gripper; worlds may differ in "
            f"{', '.join(sorted(_NOISE))} and in the rest of the gripper: give such worlds a batch of their own."
        )
    if world.start is not None:
        return world.start
    settings = RunSettings(world.n_robots, steps=1, seed=world.seed, failed_fraction=world.failed_fraction)
    return draw_start(own, settings, world.index)
