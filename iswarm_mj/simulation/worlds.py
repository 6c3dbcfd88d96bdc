"""Worlds of a run: what each of them is, and the arrays that they begin with."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any

import jax
import jax.numpy as jnp
import numpy as np

from iswarm_mj.config.swarm import SwarmConfig
from iswarm_mj.geometry.robot import Robots
from iswarm_mj.sensors.arena import Arena, arena_of
from iswarm_mj.sensors.conditions import Conditions, conditions_of
from iswarm_mj.simulation.layout_checks import check_balls, check_poses, check_start
from iswarm_mj.simulation.layouts import Start, draw_start, draw_start_with, with_boxes_laid
from iswarm_mj.simulation.shared_settings import check_shared_settings
from iswarm_mj.strategy.genome import Genome
from iswarm_mj.strategy.rules import rules_of_worlds
from iswarm_mj.strategy.vector_strategy import VectorStrategy
from iswarm_mj.tasks.base import Task, has_balls
from iswarm_mj.utils.arrays import Array
from iswarm_mj.utils.constraints import Within, check, check_kind, validate
from iswarm_mj.utils.user_code import user_code

_AT_ONCE = 64
"""Worlds whose keys a program makes; one by one, 4096 take half a second."""


@dataclass(frozen=True)
class World:
    """One world of a run; what is not given is as in the run's configuration."""

    genome: Genome
    """The paper's strategy with these parameters (Table 2); ignored in a run of another
    strategy."""
    n_robots: Annotated[int, Within(1)]
    """Robots in this world."""
    seed: Annotated[int, Within(0, 2**32 - 2)] = 0
    """Seed of the world's random numbers."""
    index: Annotated[int, Within(0)] = 0
    """Number of the world under its seed: the same world as world `index` of a run with this
    seed."""
    failed_fraction: Annotated[float, Within(0, 1)] = 0.0
    """Share of the robots that are dead from the start."""
    config: SwarmConfig | None = None
    """Settings of this world, which may differ from the run's in
    `shared_settings.PER_WORLD_FIELDS`: noise, voltages, adhesion, places, the readings."""
    start: Start | None = None
    """How the world begins; drawn from its key, or from its seed, if not given."""
    key: Array | None = None
    """Random key of the world, in place of seed and index."""

    def __post_init__(self):
        validate(self)
        is_key = isinstance(self.key, jax.Array) and jnp.issubdtype(
            self.key.dtype, jax.dtypes.prng_key
        )
        is_one = self.key is None or (is_key and not self.key.ndim)
        check("key", self.key, "one random key, as jax.random.key(0)", is_one)

    @property
    def random_key(self) -> Array:
        """Key of the world's noise and of its robots' chances."""
        return (
            jax.random.fold_in(jax.random.key(self.seed), self.index)
            if self.key is None
            else self.key
        )


def starts_of(
    config: SwarmConfig, task: Task, robot: Robots, worlds: Sequence[World]
) -> list[Start]:
    """Return how each world of a task begins.

    Raises:
        UserError: a world differs in what all worlds of a run share, or cannot begin so.
    """
    for own in {world.config for world in worlds if world.config is not None}:
        check_shared_settings(config, own)
    # The shapes of a task's state may depend on the number of robots.
    first_of_size: dict[int, Start] = {}
    first_of_key: dict[Any, Start] = {}
    starts = []
    for world in worlds:
        if world.start is None:
            start = _draw_start(config, task, robot, world, first_of_key)
            first_of_size.setdefault(world.n_robots, start)
        else:
            if world.n_robots not in first_of_size:
                like_it = replace(world, start=None, key=None)
                first_of_size[world.n_robots] = _draw_start(config, task, robot, like_it, {})
            start = _checked_start(config, task, robot, world, first_of_size[world.n_robots])
        starts.append(start)
    return starts


def random_keys(worlds: Sequence[World]) -> Array:
    """Return the `World.random_key` of B worlds (B,); on the way they are on the host: JAX would
    compile for each B."""
    if any(world.key is not None for world in worlds):
        keys = [world.random_key for world in worlds]
        data = np.stack(jax.device_get([jax.random.key_data(key) for key in keys]))
        return jax.random.wrap_key_data(jax.device_put(data), impl=jax.random.key_impl(keys[0]))
    numbers = np.zeros((2, -(-len(worlds) // _AT_ONCE), _AT_ONCE), np.uint32)
    numbers.reshape(2, -1)[:, : len(worlds)] = (
        [world.seed for world in worlds],
        [world.index for world in worlds],
    )
    data = np.concatenate([_key_data(*part) for part in numbers.swapaxes(0, 1)])[: len(worlds)]
    return jax.random.wrap_key_data(jax.device_put(data))


def conditions_of_worlds(config: SwarmConfig, worlds: Sequence[World]) -> Conditions:
    """Return the conditions of B worlds, NumPy arrays (B,); of worlds without a configuration those
    of the run's."""
    each = [conditions_of(world.config or config) for world in worlds]
    columns = zip(*each, strict=True)
    return Conditions(
        *(
            np.array(column, bool if isinstance(column[0], bool) else np.float32)
            for column in columns
        )
    )


def arenas_of_worlds(config: SwarmConfig, worlds: Sequence[World]) -> Arena:
    """Return the arenas of B worlds, NumPy arrays (B, ...); of worlds without a configuration those
    of the run's."""
    each = [arena_of((world.config or config).arena) for world in worlds]
    return jax.tree.map(lambda *values: np.stack(values), *each)


def vector_strategies(
    config: SwarmConfig, robot: Robots, worlds: Sequence[World]
) -> VectorStrategy:
    """Return the paper's strategy with the genome and the readings of each world, stacked along a
    first axis."""
    rules = rules_of_worlds(
        [world.genome for world in worlds], [(world.config or config).strategy for world in worlds]
    )
    n_scouts = np.array(
        [round(world.genome.fraction_scouts * world.n_robots) for world in worlds], np.int32
    )
    return VectorStrategy(rules, n_scouts, config.static, robot)


@jax.jit
@jax.vmap
def _key_data(seed: Array, index: Array) -> Array:
    return jax.random.key_data(jax.random.fold_in(jax.random.key(seed), index))


def _draw_start(
    config: SwarmConfig, task: Task, robot: Robots, world: World, first_of_key: dict[Any, Start]
) -> Start:
    """Draw how a world begins.

    Args:
        config: of the run.
        task: lays out robots and all else.
        robot: geometry.
        world: to be drawn.
        first_of_key: starts that were drawn from keys, which worlds of equal keys share.
    """
    config = world.config or config
    if world.key is None:
        return draw_start(
            config, task, robot, world.n_robots, world.seed, world.index, world.failed_fraction
        )
    key_data = np.asarray(jax.random.key_data(world.key))
    identity = (key_data.tobytes(), world.n_robots, world.failed_fraction, config)
    if identity not in first_of_key:
        rng = np.random.default_rng(key_data)
        first_of_key[identity] = draw_start_with(
            config,
            task,
            robot,
            world.n_robots,
            rng,
            shared=rng,
            failed_fraction=world.failed_fraction,
        )
    return first_of_key[identity]


def _checked_start(
    config: SwarmConfig, task: Task, robot: Robots, world: World, drawn: Start
) -> Start:
    """Return the start that is given for a world.

    Args:
        config: of the run.
        task: of the run.
        robot: geometry.
        world: with a start.
        drawn: a start of the same number of robots, whose state has the right shapes.

    Raises:
        UserError: the world cannot begin so.
    """
    config = world.config or config
    check_kind("start", world.start, Start)
    start: Any = world.start
    if start.boxes is None:
        start = start._replace(boxes=config.arena.boxes)
    config = with_boxes_laid(config, start.boxes, "start")
    check_start(start, drawn)
    check_poses("start.poses", np.asarray(start.poses), robot, config.arena)
    if has_balls(task):
        with user_code(f"{type(task).__name__}.balls"):
            balls = task.balls(start.task)
        check_balls(balls, world.n_robots, config.arena)
    return start
