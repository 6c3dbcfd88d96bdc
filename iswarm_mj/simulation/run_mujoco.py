"""Runs of a swarm: time, worlds, seeds, faults."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import mujoco.batch
import numpy as np

from iswarm_mj.config import SwarmConfig, conditions_of
from iswarm_mj.engines.arena import ArenaModel, compile_arena
from iswarm_mj.engines.base import Engine
from iswarm_mj.engines.mujoco.engine import MujocoBatchEngine
from iswarm_mj.gripper.handling import Balls
from iswarm_mj.sensors.links import Links
from iswarm_mj.sensors.optics import N_SIDES
from iswarm_mj.simulation import initial as layout
from iswarm_mj.simulation import step as swarm
from iswarm_mj.simulation.metrics import Measures, measure
from iswarm_mj.simulation.step import SwarmState
from iswarm_mj.strategy import controller
from iswarm_mj.strategy.genome import Genome
from iswarm_mj.strategy.vector_strategy import VectorStrategy
from iswarm_mj.utils.constraints import check
from iswarm_mj.utils.errors import SimulationFault
from iswarm_mj.utils.profiling import Stopwatch
from iswarm_mj.utils.units import mm_from_rd


@dataclass(frozen=True)
class RunSettings:
    """One run of B worlds; world w of seed s has its own random numbers, the same in any batch."""

    n_robots: int
    """N, robots in each world."""
    steps: int
    """Control steps at most."""
    seed: int = 0
    """Seed of all random numbers."""
    n_worlds: int = 1
    """B, independent worlds at once."""
    n_threads: int = 0
    """Threads for physics, 0 for one a core; the results do not depend on it."""
    stop_at: int | None = None
    """A world is finished when this many balls are delivered; None for all."""
    failed_fraction: float = 0.0
    """Share of the robots that are dead from the start: they only stand in the way."""
    n_places: int | None = None
    """Robots that the compiled program has room for, at least `n_robots`; None for exactly those.

    Runs of different numbers of robots share a program, which takes seconds to compile, if they have as many places.
    """

    def __post_init__(self):
        if self.n_places is not None:
            check("n_places", self.n_places, "at least the number of robots", self.n_places >= self.n_robots)
        check("failed_fraction", self.failed_fraction, "within 0 to 1", 0 <= self.failed_fraction <= 1)


class StepView(NamedTuple):
    """What an observer of a run gets to see after each control step, and once at the start (step 0)."""

    step: int
    poses: np.ndarray
    """(B, N, 3) x, y [mm] and yaw [rad]."""
    state: SwarmState
    links: Links
    """Links of the control step that led here; none at the start."""
    has_priority: np.ndarray
    """(B, N) bool."""
    balls: np.ndarray
    """(B, K, 3) the balls' centres [mm]."""
    collisions: np.ndarray
    """(B,) so far."""
    speed: np.ndarray
    """(B,) mean distance that the robots moved in this step, per second [mm/s]."""


Observer = Callable[[StepView], None]


class Start(NamedTuple):
    """How one world begins."""

    poses: np.ndarray
    """(N, 3) x, y [mm] and yaw [rad]."""
    balls: Balls
    is_alive: np.ndarray
    """(N,) bool."""


@dataclass
class Run:
    """A run in progress: B worlds that `advance` together until each is finished."""

    config: SwarmConfig
    genome: Genome
    settings: RunSettings
    starts: list[Start] | None = None
    """How each world begins; drawn by the seed if not given."""
    watch: Stopwatch = field(default_factory=Stopwatch)

    def __post_init__(self):
        c, s = self.config, self.settings
        layout.check_robots(c.arena, s.n_robots)
        if self.starts is None:
            self.starts = [draw_start(c, s, world) for world in range(s.n_worlds)]
        self.arena: ArenaModel = compile_arena(c, s.n_robots, np.asarray(self.starts[0].balls.radius, float))
        self.engine: Engine = MujocoBatchEngine(self.arena, s.n_worlds, s.n_threads)
        balls = jax.tree.map(lambda *a: jnp.stack([jnp.asarray(x) for x in a]), *[start.balls for start in self.starts])
        alive = jnp.stack([jnp.asarray(start.is_alive) for start in self.starts])
        self._sends = np.asarray(alive)
        n_scouts = jnp.asarray(round(self.genome.fraction_scouts * s.n_robots))
        reach = float(self.arena.probe[0])
        same = VectorStrategy(controller.rules_of(self.genome), n_scouts, c, reach), conditions_of(c)
        self._strategy, self._conditions = jax.tree.map(lambda a: jnp.full(s.n_worlds, a), same)
        key = jax.random.key(s.seed)
        self._keys = jax.vmap(lambda w: jax.random.fold_in(key, w))(jnp.arange(s.n_worlds))
        places = s.n_places or s.n_robots
        memories = jax.vmap(lambda strategy, key: strategy.init(places, key))(self._strategy, self._keys)
        self._state = SwarmState(memories, balls, jnp.asarray(self._seated(self._sends)))
        self.step = 0
        self.collisions = np.zeros(s.n_worlds, int)
        self.finished_at: list[int | None] = [None] * s.n_worlds
        self._touching = [np.zeros(0, int)] * s.n_worlds
        poses = np.stack([start.poses for start in self.starts])
        self.engine.reset(poses, self._ball_centres(poses))

    @property
    def state(self) -> SwarmState:
        """State of all worlds, without empty places."""
        n, (memory, balls, is_alive) = self.settings.n_robots, self._state
        return self._state if is_alive.shape[1] == n else SwarmState(_first(memory, n), balls, _first(is_alive, n))

    @property
    def is_over(self) -> bool:
        """Whether the time is up or every world is finished."""
        return self.step >= self.settings.steps or None not in self.finished_at

    def advance(self) -> StepView:
        """Take one control step.

        Raises:
            SimulationFault: a robot has no finite pose or is outside the walls.
        """
        running = np.array([f is None for f in self.finished_at])
        worlds = np.flatnonzero(running)
        before = self.engine.poses()
        self._check(before)
        with self.watch("sense"):
            links, sees_wall = swarm.see(self.config, self.engine, before, self._sends)
        with self.watch("act"):
            seated = jax.tree.map(self._seated, (before.astype(np.float32), links, sees_wall))
            self._state, command, priority = jax.block_until_ready(swarm.decide_worlds(
                self.config, tuple(self.arena.probe.tolist()), self._conditions, self._strategy, self._state,
                *seated, self.step, self._keys, running,
            ))  # fmt: skip
            command, priority = _first((command, priority), self.settings.n_robots)
        with self.watch("physics"):
            try:
                touching = swarm.drive(self.config, self.engine, command, worlds)
            except mujoco.batch.SimulationError as error:
                raise SimulationFault(
                    f"step {self.step + 1}: MuJoCo stopped in world {', '.join(map(str, error.ids))}: {error}"
                ) from None
            poses = self.engine.poses()
            self._check(poses)
            balls = self._ball_centres(poses)
            self.engine.move_balls(balls)
        self.step += 1
        self._count(worlds, touching)
        moved = np.linalg.norm(poses[..., :2] - before[..., :2], axis=-1).mean(axis=1)
        return StepView(
            self.step, poses, self.state, links, np.asarray(priority), balls, self.collisions.copy(),
            moved / self.config.drive.control_period,
        )  # fmt: skip

    def start_view(self) -> StepView:
        """Return the view of the start."""
        s, poses = self.settings, self.engine.poses()
        shape = (*poses.shape[:2], N_SIDES)
        nobody = Links(np.zeros(shape, np.int32), np.zeros(shape, bool), *[np.zeros(shape)] * 3)
        priority = np.zeros(poses.shape[:2], bool)
        balls = self._ball_centres(poses)
        return StepView(0, poses, self.state, nobody, priority, balls, self.collisions.copy(), np.zeros(s.n_worlds))

    def measures(self, world: int) -> Measures:
        """Return the measures of a world so far."""
        return measure(self._state.balls, world, int(self.collisions[world]), self.finished_at[world])

    def _count(self, worlds: np.ndarray, touching: list[np.ndarray]) -> None:
        delivered = np.asarray(self._state.balls.is_delivered).sum(axis=1)
        goal = self.settings.stop_at or self.config.arena.n_dust
        for world, pairs in zip(worlds, touching, strict=True):
            self.collisions[world] += len(np.setdiff1d(pairs, self._touching[world], assume_unique=True))
            self._touching[world] = pairs
            if delivered[world] >= goal:
                self.finished_at[world] = self.step

    def _seated(self, values: np.ndarray) -> np.ndarray:
        """Values of robots (B, N, ...) with zeros, or false, for the empty places after them (B, P, ...)."""
        places = self.settings.n_places or values.shape[1]
        if places == values.shape[1]:
            return values
        filled = np.zeros((len(values), places, *values.shape[2:]), values.dtype)
        filled[:, : values.shape[1]] = values
        return filled

    def _ball_centres(self, poses: np.ndarray) -> np.ndarray:
        return swarm.ball_centres(self._state, poses, self.arena.probe, self.arena.tip_height)

    def _check(self, poses: np.ndarray) -> None:
        """Raise a SimulationFault if a robot has no finite pose or is outside the walls."""
        edge = mm_from_rd(self.config.arena.size) / 2
        lost = ~np.isfinite(poses).all(axis=-1) | ~(np.abs(poses[..., :2]).max(axis=-1) < edge)
        if lost.any():
            world = int(np.flatnonzero(lost.any(axis=1))[0])
            robots = np.flatnonzero(lost[world])
            names = ", ".join(map(str, robots[:10])) + (" and more" if len(robots) > 10 else "")
            raise SimulationFault(
                f"step {self.step + 1}, world {world}: robots {names} left the arena or have no finite pose"
            )


def _first(tree: Any, n: int) -> Any:
    """Arrays (B, P, ...) without what comes after the first n places (B, n, ...)."""
    return jax.tree.map(lambda a: np.asarray(a)[:, :n], tree)


def draw_start(config: SwarmConfig, settings: RunSettings, world: int) -> Start:
    """Draw how a world begins; all worlds of a seed have balls of the same radii, since they share one model."""
    radii = layout.draw_radii(config.arena, np.random.default_rng([settings.seed, 2**32 - 1]))
    rng = np.random.default_rng([settings.seed, world])
    return start_with(config, settings.n_robots, radii, rng, settings.failed_fraction)


def start_with(
    config: SwarmConfig, n_robots: int, radii: np.ndarray, rng: np.random.Generator, failed_fraction: float = 0.0
) -> Start:
    """Draw how a world with balls of these radii (K,) [m] begins."""
    poses = layout.place_robots(config.arena, n_robots, rng)
    position = layout.place_balls(config.arena, rng)
    works = layout.draw_works(config.gripper, len(radii), rng)
    floats = (a.astype(np.float32) for a in (position, radii, *works))
    no, zero = np.zeros(len(radii), bool), np.zeros(len(radii), np.int32)
    balls = Balls(*floats, is_held=no, is_delivered=no, holder=zero, was_picked=no, carried_steps=zero)
    is_alive = np.ones(n_robots, bool)
    is_alive[rng.permutation(n_robots)[: round(failed_fraction * n_robots)]] = False
    return Start(poses, balls, is_alive)
