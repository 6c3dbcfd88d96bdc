"""Worlds of a run: what each of them is, and the arrays that they begin with."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import jax
import jax.numpy as jnp
import numpy as np

from iswarm_mj.config.swarm import SwarmConfig
from iswarm_mj.geometry.robot import Robots
from iswarm_mj.sensors.arena import Arena, arena_of
from iswarm_mj.sensors.conditions import Conditions, conditions_of
from iswarm_mj.simulation.layout_checks import check_balls, check_poses, check_start
from iswarm_mj.simulation.layouts import Start, draw_start, with_boxes_laid
from iswarm_mj.simulation.settings import RunSettings
from iswarm_mj.simulation.shared_settings import check_shared_settings
from iswarm_mj.strategy.genome import Genome
from iswarm_mj.strategy.rules import rules_of_worlds
from iswarm_mj.strategy.user_code import user_code
from iswarm_mj.strategy.vector_strategy import VectorStrategy
from iswarm_mj.tasks.base import Task, has_balls
from iswarm_mj.utils.arrays import Array
from iswarm_mj.utils.constraints import Within, check, check_kind, validate

_AT_ONCE = 64
"""Worlds whose keys a program makes; one by one, 4096 take half a second."""


@dataclass(frozen=True)
class World:
    """One world of a run; what is not given is as in the run's configuration."""

    genome: Genome
    """The paper's strategy with these parameters (Table 2); ignored in a run of another strategy."""
    n_robots: Annotated[int, Within(1)]
    """Robots in this world."""
    seed: Annotated[int, Within(0, 2**32 - 2)] = 0
    """Seed of the world's random numbers."""
    index: Annotated[int, Within(0)] = 0
    """Number of the world under its seed: the same world as world `index` of a run with this seed."""
    failed_fraction: Annotated[float, Within(0, 1)] = 0.0
    """Share of the robots that are dead from the start."""
    config: SwarmConfig | None = None
    """Settings of this world, which may differ from the run's in `shared_settings.PER_WORLD_FIELDS`: noise, voltages,
    adhesion, places, the readings."""
    start: Start | None = None
    """How the world begins; drawn from its seed if not given."""
    key: Array | None = None
    """Random key of what happens then; from seed and index if not given."""

    def __post_init__(self):
        validate(self)
        is_key = isinstance(self.key, jax.Array) and jnp.issubdtype(self.key.dtype, jax.dtypes.prng_key)
        is_one = self.key is None or (is_key and not self.key.ndim)
        check("key", self.key, "one random key, as jax.random.key(0)", is_one)

    @property
    def random_key(self) -> Array:
        """Key of the world's noise and of its robots' chances."""
        return jax.random.fold_in(jax.random.key(self.seed), self.index) if self.key is None else self.key


def worlds_of_seed(genome: Genome, settings: RunSettings) -> list[World]:
    """Return the worlds of a run's seed, numbered from 0."""
    s = settings
    return [World(genome, s.n_robots, s.seed, index, s.failed_fraction) for index in range(s.n_worlds)]


def starts_of(config: SwarmConfig, task: Task, robot: Robots, worlds: Sequence[World]) -> list[Start]:
    """Return how each world of a task begins.

    Raises:
        UserError: a world differs in what all worlds of a run share, or cannot begin so.
    """
    for own in {world.config for world in worlds if world.config is not None}:
        check_shared_settings(config, own)
    usual: dict[int, Start] = {}  # by the number of robots, on which the shapes of a task's state may depend
    return [_start(config, task, robot, world, usual) for world in worlds]


def random_keys(worlds: Sequence[World]) -> Array:
    """Return the `World.random_key` of B worlds (B,); on the way they are on the host: JAX would compile for each B."""
    if any(world.key is not None for world in worlds):
        keys = [world.random_key for world in worlds]
        data = np.stack(jax.device_get([jax.random.key_data(key) for key in keys]))
        return jax.random.wrap_key_data(jax.device_put(data), impl=jax.random.key_impl(keys[0]))
    numbers = np.zeros((2, -(-len(worlds) // _AT_ONCE), _AT_ONCE), np.uint32)
    numbers.reshape(2, -1)[:, : len(worlds)] = [world.seed for world in worlds], [world.index for world in worlds]
    data = np.concatenate([_key_data(*part) for part in numbers.swapaxes(0, 1)])[: len(worlds)]
    return jax.random.wrap_key_data(jax.device_put(data))


def conditions_of_worlds(config: SwarmConfig, worlds: Sequence[World]) -> Conditions:
    """Return the conditions of B worlds, NumPy arrays (B,); of worlds without a configuration those of the run's."""
    each = [conditions_of(world.config or config) for world in worlds]
    columns = zip(*each, strict=True)
    return Conditions(*(np.array(column, bool if isinstance(column[0], bool) else np.float32) for column in columns))


def arenas_of_worlds(config: SwarmConfig, worlds: Sequence[World]) -> Arena:
    """Return the arenas of B worlds, NumPy arrays (B, ...); of worlds without a configuration those of the run's."""
    each = [arena_of((world.config or config).arena) for world in worlds]
    return jax.tree.map(lambda *values: np.stack(values), *each)


def vector_strategies(config: SwarmConfig, robot: Robots, worlds: Sequence[World]) -> VectorStrategy:
    """Return the paper's strategy with the genome and the readings of each world, stacked along a first axis."""
    rules = rules_of_worlds([world.genome for world in worlds], [(world.config or config).strategy for world in worlds])
    n_scouts = np.array([round(world.genome.fraction_scouts * world.n_robots) for world in worlds], np.int32)
    return VectorStrategy(rules, n_scouts, config.static, robot)


@jax.jit
@jax.vmap
def _key_data(seed: Array, index: Array) -> Array:
    return jax.random.key_data(jax.random.fold_in(jax.random.key(seed), index))


def _start(config: SwarmConfig, task: Task, robot: Robots, world: World, usual: dict[int, Start]) -> Start:
    own, given, n_robots = world.config or config, world.start, world.n_robots
    if given is None or n_robots not in usual:
        drawn = draw_start(own, task, robot, n_robots, world.seed, world.index, world.failed_fraction)
        usual.setdefault(n_robots, drawn)
        if given is None:
            return drawn
    check_kind("start", given, Start)
    given = given._replace(boxes=own.arena.boxes) if given.boxes is None else given
    own = with_boxes_laid(own, given.boxes, "start")
    check_start(given, usual[n_robots])
    check_poses("start.poses", np.asarray(given.poses), robot, own.arena)
    if has_balls(task):
        with user_code(f"{type(task).__name__}.balls"):
            balls = task.balls(given.task)
        check_balls(balls, n_robots, own.arena)
    return given
