"""Base classes of engines, which place robots, sense their light and move them."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import Any, Generic, Literal, NamedTuple, TypeVar

import numpy as np
from jaxtyping import Bool, Float, Int, Shaped

from iswarm_mj.geometry.robot import Robots
from iswarm_mj.geometry.walls import beyond
from iswarm_mj.sensors.links import Links
from iswarm_mj.utils.arrays import Array, array_module
from iswarm_mj.utils.errors import FaultKind

TURN_PARTS = 2
"""Time steps of engines in each physics step in which robots turn.

A contact of two bodies is found once a time step, and its normal and points stay while they turn:
a quarter of 90 degrees moves a corner by up to 0.1 mm from where that expects it, half of it by a
quarter as much."""

Bodies = TypeVar("Bodies")
"""Mechanical state of the robots; only its engine looks inside."""


class LightReading(NamedTuple):
    """Light that N robots receive in a control step."""

    links: Links
    """The nearest sender in sight of each side (*B, N, S); where messages take time, the nearest
    `OpticsConfig.n_senders` of each (*B, N, S, K)."""
    sees_wall: Bool[Array, "*B N S"]
    """A wall reflects the light of this side's LED."""


class Phase(NamedTuple):
    """Consecutive physics steps in which servos hold the same velocities."""

    n_substeps: int
    """Number of physics steps, of `config.drive.timestep` each."""
    velocity: Callable[[Array], Array]
    """Function from the poses (*B, N, 3) as the phase begins [mm, mm, rad] to the velocities of the
    robots in the arena (*B, N, 3) [mm/s, mm/s, rad/s]."""
    boxes: Float[Array, "*B M 3"] | None = None
    """Velocities of driven boxes [mm/s, mm/s, rad/s]; those of others have no effect. None: driven
    boxes stand still."""
    parts: int = 1
    """Time steps of the engine in each of these physics steps; an engine may take others."""


class Motion(NamedTuple):
    """Outcome of `Engine.move`."""

    bodies: Any
    """Mechanical state after the motion."""
    touching: Int[Array, "*B K N"]
    """Partners of higher index of each robot, int32: those that it touches at the end of any phase,
    highest first, then 0; in a heap the highest `Robots.most_partners`."""
    fault: Int[Array, "*B"]
    """Bits of `FaultKind`; 0 if nothing went wrong, and for worlds that do not run."""
    robot: Int[Array, "*B"]
    """First robot whose pose is at fault; undefined for other faults."""


def find_lost(
    poses: Float[Array, "*B N 3"], is_present: Bool[Array, "*B N"], walls: Float[Array, "W 3"]
) -> tuple[Int[Array, "*B"], Int[Array, "*B"]]:
    """Find robots whose poses are not finite or beyond the walls.

    Args:
        poses: x, y [mm] and yaw [rad].
        is_present: robots that count.
        walls: walls of the arena, see `geometry.walls.half_planes` [mm].

    Returns:
        Bits of `FaultKind`, and the first robot whose pose is not finite or, if all are, that is
        beyond the walls; 0 if none is lost.
    """
    xp = array_module(poses)
    not_finite = ~xp.isfinite(poses).all(axis=-1) & is_present
    is_outside = (beyond(poses[..., :2], walls) >= 0) & is_present & ~not_finite

    any_not_finite = not_finite.any(axis=-1)
    fault = xp.where(any_not_finite, int(FaultKind.POSE_NOT_FINITE), 0)
    fault = fault | xp.where(is_outside.any(axis=-1), int(FaultKind.OUTSIDE), 0)

    first_not_finite = not_finite.argmax(axis=-1)
    first_outside = is_outside.argmax(axis=-1)
    robot = xp.where(any_not_finite, first_not_finite, first_outside)
    return fault.astype(xp.int32), robot.astype(xp.int32)


class FreeBodies(NamedTuple):
    """Complete mechanical state of N robots, followed by M boxes, in one world or in several."""

    poses: Float[Array, "*B NM 3"]
    """x, y [mm] and yaw [rad], which is not wrapped."""
    velocity: Float[Array, "*B NM 3"]
    """Velocities [mm/s, mm/s, rad/s]."""
    is_present: Bool[Array, "*B NM"]
    """Bodies that take part; the others stay where they are, and touch and hide nothing."""
    overlap: Any = None
    """Deepest overlap of bodies with each other and with walls (B,) [mm], at the beginning of each
    time step of the latest control step; None where the engine does not measure it."""
    work: Any = None
    """Work that each world took in its latest phase (B,), in a unit of the engine; for engines that
    begin with the slowest worlds."""


class BoxesMixin(ABC):
    """Part of engines whose bodies have `poses` (*B, N + M, 3), robots first and boxes last."""

    @property
    @abstractmethod
    def n_boxes(self) -> int:
        """Number of boxes M."""

    def n_robots(self, bodies: Any) -> int:
        """Return the number of robots N."""
        return bodies.poses.shape[-2] - self.n_boxes

    def poses(self, bodies: Any) -> Float[Array, "*B N 3"]:
        """Return the poses of the robots; see `Engine.poses`."""
        return bodies.poses[..., : self.n_robots(bodies), :]

    def boxes(self, bodies: Any) -> Float[Array, "*B M 3"]:
        """Return the poses of the boxes; see `Engine.boxes`."""
        return bodies.poses[..., self.n_robots(bodies) :, :]


def with_boxes(is_present: Shaped[Array, "*B N"], n_boxes: int) -> Shaped[Array, "*B NM"]:
    """Return the flags of robots, followed by those of boxes, which are all present."""
    xp = array_module(is_present)
    all_boxes = xp.ones((*is_present.shape[:-1], n_boxes), bool)
    return xp.concatenate([is_present, all_boxes], axis=-1)


def set_points(
    phase: Phase, poses: Float[Array, "*B NM 3"], n_robots: int
) -> Float[Array, "*B NM 3"]:
    """Return the velocities that the drives of robots and boxes hold in a phase.

    Args:
        phase: the phase.
        poses: poses as it begins [mm, mm, rad].
        n_robots: number of robots.
    """
    xp = array_module(poses)
    robots = phase.velocity(poses[..., :n_robots, :])
    boxes = phase.boxes
    if boxes is None:
        boxes = xp.zeros_like(poses[..., n_robots:, :])
    return xp.concatenate([robots, boxes], axis=-2) if boxes.size else robots


StepBodies = Callable[[Any, Array, Phase, Array, Array], tuple[Any, Array, Array]]
"""Function that takes the physics steps of a phase.

Its arguments are the bodies, the set points of their drives (*B, N, 3) [mm/s, mm/s, rad/s], the
phase, which worlds take its steps (*B,), and the partners in contact so far (see
`Motion.touching`). It returns bodies, partners in contact, and bits of `FaultKind` (*B,)."""


def take_phases(
    bodies: Any,
    phases: Sequence[Phase],
    is_running: Bool[Array, "*B"],
    walls: Array,
    robot: Robots,
    n_robots: int,
    step_bodies: StepBodies,
) -> Motion:
    """Take the steps of one phase after the other, as `Engine.move` must.

    A world with a fault takes no more steps.

    Args:
        bodies: named tuple of arrays or None, the first axes those of worlds; has `poses` and
            `is_present`.
        phases: phases of the motion.
        is_running: worlds that move.
        walls: walls of the arena, see `geometry.walls.half_planes` [mm].
        robot: geometry of the robots.
        n_robots: number of robots; bodies beyond them have no drives.
        step_bodies: function that takes the steps of a phase.
    """
    xp = array_module(bodies.poses)
    moved = bodies
    fault = xp.zeros(is_running.shape, xp.int32)
    touching = xp.zeros((*is_running.shape, robot.most_partners, n_robots), xp.int32)
    for phase in phases:
        targets = set_points(phase, moved.poses, n_robots)
        runs = is_running & (fault == 0)
        moved, touching, failure = step_bodies(moved, targets, phase, runs, touching)
        fault = fault | failure
    return finish_motion(bodies, moved, touching, fault, is_running, walls)


def finish_motion(
    bodies: Any, moved: Any, touching: Array, fault: Array, is_running: Array, walls: Array
) -> Motion:
    """Return the outcome of a motion.

    Lost robots are faults, too, and worlds with faults keep the bodies that they had before.

    Args:
        bodies: bodies before the motion.
        moved: bodies after it.
        touching: partners in contact, see `Motion.touching`.
        fault: bits of `FaultKind` that occurred on the way.
        is_running: worlds that moved.
        walls: walls of the arena, see `geometry.walls.half_planes` [mm].
    """
    xp = array_module(bodies.poses)
    lost, robot = find_lost(moved.poses, bodies.is_present, walls)
    fault = xp.where(is_running, fault | lost, 0).astype(xp.int32)
    keeps_old = ~is_running | (fault != 0)

    def choose(old: Any, new: Any) -> Any:
        """Return the values of an array after the motion; None where the engine has none."""
        if new is None:
            return None
        trailing_axes = [None] * (new.ndim - keeps_old.ndim)
        return xp.where(keeps_old[(..., *trailing_axes)], old, new)

    parts = [choose(old, new) for old, new in zip(bodies, moved, strict=True)]
    return Motion(type(bodies)(*parts), touching, fault, robot)


class Engine(ABC, Generic[Bodies]):
    """Rigid-body physics and light of worlds with N robots each. Units: mm, mg, s, rad.

    An engine of your own derives from this class, or from `CompiledEngine`, has an attribute
    `robot`, and writes the four methods; `take_phases` and `sensors.links.find_links` help with two
    of them.

    An engine acts either on one world, and is mapped over worlds by `jax.vmap`, or on B worlds at
    once, and all arrays have a leading axis; `*B` stands for either.
    """

    robot: Robots
    """Geometry and mass of the robots."""

    @abstractmethod
    def place(self, poses: Float[Array, "*B NM 3"], is_present: Bool[Array, "*B N"]) -> Bodies:
        """Return robots, and boxes after them, at rest at x, y [mm] and yaw [rad].

        Robots that are not present neither touch nor hide anything. Only engines whose settings say
        `has_boxes` are given boxes.
        """

    @abstractmethod
    def poses(self, bodies: Bodies) -> Float[Array, "*B N 3"]:
        """Return x, y [mm] and yaw [rad] of the robots; yaw is not wrapped."""

    @abstractmethod
    def sense(self, bodies: Bodies, emits: Array, is_running: Bool[Array, "*B"]) -> LightReading:
        """Find links and walls in sight.

        Args:
            bodies: mechanical state.
            emits: robots that send light (*B, N), bool, or the power of their LEDs from 0 to 1;
                dark robots still stand in the way.
            is_running: worlds that need an answer; that of the others is undefined.
        """

    @abstractmethod
    def move(
        self, bodies: Bodies, phases: Sequence[Phase], is_running: Bool[Array, "*B"]
    ) -> Motion:
        """Take the physics steps of some phases, one after the other.

        A world that does not run, or in which a fault occurs, keeps its bodies.
        """

    def boxes(self, bodies: Bodies) -> Float[Array, "*B M 3"] | None:
        """Return x, y [mm] and yaw [rad] of the boxes (`ArenaConfig.boxes`), or None.

        Yaw is not wrapped. Engines that take no boxes return None.
        """
        return None


def boxes_of(engine: Engine, bodies: Any) -> Float[Array, "*B M 3"] | None:
    """Return x, y [mm] and yaw [rad] of the boxes; None where there are none."""
    boxes = engine.boxes(bodies)
    return boxes if boxes is not None and boxes.shape[-2] else None


def poses_of_bodies(engine: Engine, bodies: Any) -> Float[np.ndarray, "*B NM 3"]:
    """Return x, y [mm] and yaw [rad] of robots, and of boxes after them, as a NumPy array."""
    robots = np.asarray(engine.poses(bodies))
    boxes = boxes_of(engine, bodies)
    if boxes is None:
        return np.array(robots)
    return np.concatenate([robots, np.asarray(boxes)], axis=-2)


Mapping = Literal["batch", "vmap", "in turn"]
"""Way in which a compiled program goes through its worlds.

The engine acts on all of them at once (`batch`); or it acts on one, and the program maps it over
the worlds (`vmap`), or computes them one after the other (`in turn`).
"""


class CompiledEngine(Engine[Bodies]):
    """An engine that acts inside programs compiled by JAX; a pytree."""

    @abstractmethod
    def mapping(self, platform: str) -> Mapping:
        """Return how a program for devices of a platform, such as "cpu", goes through worlds."""
