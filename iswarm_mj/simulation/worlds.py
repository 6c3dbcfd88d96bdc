"""Worlds of a run: their description, and the arrays with which they begin."""

import math
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

_KEYS_AT_ONCE = 64
"""Number of keys that a program makes at once; one by one, 4096 take half a second."""


@dataclass(frozen=True)
class World:
    """One world of a run; settings without a value are those of the run."""

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
    """Start of the world; by default drawn from its key, or from its seed."""
    key: Array | None = None
    """Random key of the world, in place of seed and index."""

    def __post_init__(self):
        validate(self)
        allowed = "one random key, as jax.random.key(0)"
        check("key", self.key, allowed, self.key is None or _is_random_key(self.key))

    @property
    def random_key(self) -> Array:
        """Key of the world's noise and of its robots' random decisions."""
        if self.key is not None:
            return self.key
        return jax.random.fold_in(jax.random.key(self.seed), self.index)


def starts_of(
    config: SwarmConfig, task: Task, robot: Robots, worlds: Sequence[World]
) -> list[Start]:
    """Return how each world of a task begins.

    Raises:
        UserError: a world differs in what all worlds of a run share, or cannot begin so.
    """
    for world_config in {world.config for world in worlds if world.config is not None}:
        check_shared_settings(config, world_config)

    # The shapes of a task's state may depend on the number of robots. Starts of the user must have
    # those of a start that is drawn for the same number.
    example_of_size: dict[int, Start] = {}
    start_of_key: dict[Any, Start] = {}
    starts = []
    for world in worlds:
        n_robots = world.n_robots
        if world.start is None:
            start = _drawn_start(config, task, robot, world, start_of_key)
            example_of_size.setdefault(n_robots, start)
        else:
            if n_robots not in example_of_size:
                drawn_world = replace(world, start=None, key=None)
                example_of_size[n_robots] = _drawn_start(config, task, robot, drawn_world, {})
            start = _checked_start(config, task, robot, world, example_of_size[n_robots])
        starts.append(start)
    return starts


def _is_random_key(value: Any) -> bool:
    """Return whether a value is one random key of JAX."""
    if not isinstance(value, jax.Array) or value.ndim != 0:
        return False
    return jnp.issubdtype(value.dtype, jax.dtypes.prng_key)


def random_keys(worlds: Sequence[World]) -> Array:
    """Return the `World.random_key` of B worlds (B,).

    They are stacked on the host, since JAX would compile a program for each B.
    """
    if all(world.key is None for world in worlds):
        return _keys_of_seeds(worlds)
    keys = [world.random_key for world in worlds]
    data = np.stack(jax.device_get([jax.random.key_data(key) for key in keys]))
    return jax.random.wrap_key_data(jax.device_put(data), impl=jax.random.key_impl(keys[0]))


def _keys_of_seeds(worlds: Sequence[World]) -> Array:
    """Return the random keys of worlds (B,) from their seeds and indices."""
    n_worlds = len(worlds)
    n_groups = math.ceil(n_worlds / _KEYS_AT_ONCE)

    # The last group is filled up with zeros, so that all have the same shape.
    seeds = np.zeros(n_groups * _KEYS_AT_ONCE, np.uint32)
    indices = np.zeros(n_groups * _KEYS_AT_ONCE, np.uint32)
    seeds[:n_worlds] = [world.seed for world in worlds]
    indices[:n_worlds] = [world.index for world in worlds]

    groups = zip(np.split(seeds, n_groups), np.split(indices, n_groups), strict=True)
    data = np.concatenate([_key_data(seed, index) for seed, index in groups])
    return jax.random.wrap_key_data(jax.device_put(data[:n_worlds]))


def conditions_of_worlds(config: SwarmConfig, worlds: Sequence[World]) -> Conditions:
    """Return the conditions of B worlds as NumPy arrays (B,).

    Args:
        config: configuration of worlds without one of their own.
        worlds: the worlds.
    """
    conditions = [conditions_of(world.config or config) for world in worlds]
    arrays = []
    for column in zip(*conditions, strict=True):
        dtype = bool if isinstance(column[0], bool) else np.float32
        arrays.append(np.array(column, dtype))
    return Conditions(*arrays)


def arenas_of_worlds(config: SwarmConfig, worlds: Sequence[World]) -> Arena:
    """Return the arenas of B worlds as NumPy arrays (B, ...).

    Args:
        config: configuration of worlds without one of their own.
        worlds: the worlds.
    """
    arenas = [arena_of((world.config or config).arena) for world in worlds]
    return jax.tree.map(lambda *values: np.stack(values), *arenas)


def vector_strategies(
    config: SwarmConfig, robot: Robots, worlds: Sequence[World]
) -> VectorStrategy:
    """Return the paper's strategy with a first axis of worlds.

    Args:
        config: configuration of worlds without one of their own.
        robot: geometry of the robots.
        worlds: worlds with their genomes and interpretations of the paper.
    """
    genomes = [world.genome for world in worlds]
    settings = [(world.config or config).strategy for world in worlds]
    rules = rules_of_worlds(genomes, settings)
    n_scouts = [round(world.genome.fraction_scouts * world.n_robots) for world in worlds]
    return VectorStrategy(rules, np.array(n_scouts, np.int32), config.static, robot)


@jax.jit
@jax.vmap
def _key_data(seed: Array, index: Array) -> Array:
    """Return the data of the random key of a seed and an index."""
    return jax.random.key_data(jax.random.fold_in(jax.random.key(seed), index))


def _drawn_start(
    config: SwarmConfig, task: Task, robot: Robots, world: World, start_of_key: dict[Any, Start]
) -> Start:
    """Return the start that is drawn for a world from its random key, or from seed and index.

    Args:
        config: configuration of the run, for a world without one of its own.
        task: task of the run, which lays out robots and balls.
        robot: geometry of the robots.
        world: the world.
        start_of_key: starts drawn so far in this run for worlds with keys; a new one is added.
            Worlds that are equal in key, robots and settings share a start.
    """
    config = world.config or config
    if world.key is None:
        return draw_start(
            config, task, robot, world.n_robots, world.seed, world.index, world.failed_fraction
        )

    key_data = np.asarray(jax.random.key_data(world.key))
    identity = (key_data.tobytes(), world.n_robots, world.failed_fraction, config)
    if identity not in start_of_key:
        # Only worlds of one seed have draws in common; with a key, one generator serves for all.
        rng = np.random.default_rng(key_data)
        start_of_key[identity] = draw_start_with(
            config,
            task,
            robot,
            world.n_robots,
            rng,
            shared=rng,
            failed_fraction=world.failed_fraction,
        )
    return start_of_key[identity]


def _checked_start(
    config: SwarmConfig, task: Task, robot: Robots, world: World, example: Start
) -> Start:
    """Return the user's start of a world, with its boxes.

    Args:
        config: configuration of the run.
        task: task of the run.
        robot: geometry of the robots.
        world: world with a start.
        example: a start of the same number of robots, whose task state has the right shapes.

    Raises:
        UserError: the world cannot begin so.
    """
    config = world.config or config
    check_kind("start", world.start, Start)
    start: Any = world.start
    if start.boxes is None:
        start = start._replace(boxes=config.arena.boxes)
    config = with_boxes_laid(config, start.boxes, "start")
    check_start(start, example)
    check_poses("start.poses", np.asarray(start.poses), robot, config.arena)
    if has_balls(task):
        with user_code(f"{type(task).__name__}.balls"):
            balls = task.balls(start.task)
        check_balls(balls, world.n_robots, config.arena)
    return start
