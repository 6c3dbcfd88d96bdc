"""What every engine can do: put robots somewhere, sense light, move."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import Any, Generic, Literal, NamedTuple, TypeVar

from jaxtyping import Bool, Float, Int, Shaped

from iswarm_mj.geometry.robot import Robots
from iswarm_mj.geometry.walls import beyond
from iswarm_mj.sensors.links import Links
from iswarm_mj.utils.arrays import Array, array_module
from iswarm_mj.utils.errors import FaultKind

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
    """Of `config.drive.timestep` each."""
    velocity: Callable[[Array], Array]
    """From the poses (*B, N, 3) as the phase begins to world velocities (*B, N, 3) [mm/s, mm/s,
    rad/s]."""
    boxes: Float[Array, "*B M 3"] | None = None
    """Velocities of driven boxes, likewise; those of others have no effect. None: they stand
    still."""


class Motion(NamedTuple):
    """Outcome of `Engine.move`."""

    bodies: Any
    touching: Int[Array, "*B K N"]
    """int32, the robots of higher index in contact with each robot at the end of any phase, highest
    first, then 0; in a heap the highest `Robots.most_partners`."""
    fault: Int[Array, "*B"]
    """Bits of `FaultKind`; 0 if nothing went wrong."""
    robot: Int[Array, "*B"]
    """The first robot concerned, where the fault is one of poses."""


def find_lost(
    poses: Float[Array, "*B N 3"], is_present: Bool[Array, "*B N"], walls: Float[Array, "W 3"]
) -> tuple[Int[Array, "*B"], Int[Array, "*B"]]:
    """Return faults of poses that are not finite or beyond the walls, as bits of `FaultKind`, and
    the first robot.

    Args:
        poses: x, y [mm] and yaw [rad].
        is_present: the other robots do not count.
        walls: see `utils.walls.half_planes` [mm].
    """
    xp = array_module(poses)
    not_finite = ~xp.isfinite(poses).all(axis=-1) & is_present
    outside = (beyond(poses[..., :2], walls) >= 0) & is_present & ~not_finite
    bits = xp.where(not_finite.any(axis=-1), int(FaultKind.POSE_NOT_FINITE), 0)
    bits = bits | xp.where(outside.any(axis=-1), int(FaultKind.OUTSIDE), 0)
    first = xp.where(not_finite.any(axis=-1), not_finite.argmax(axis=-1), outside.argmax(axis=-1))
    return bits.astype(xp.int32), first.astype(xp.int32)


class FreeBodies(NamedTuple):
    """Mechanical state of N robots, and of boxes after them, in one world or in several, all of which is here."""

    poses: Float[Array, "*B NM 3"]
    """x, y [mm] and yaw [rad], which is not wrapped."""
    velocity: Float[Array, "*B NM 3"]
    """[mm/s, mm/s, rad/s]"""
    is_present: Bool[Array, "*B NM"]
    """The others stay where they are, and touch and hide nothing."""
    overlap: Any = None
    """(B,) deepest overlap of bodies with each other and with walls since the latest control step
    began [mm]; None where the engine does not look for it."""
    work: Any = None
    """(B,) what an engine that begins with the slowest worlds counted in the latest phase of
    each."""


class BoxesMixin(ABC):
    """Part of engines whose bodies have `poses` (*B, N + M, 3), those of robots and then of boxes."""

    @property
    @abstractmethod
    def n_boxes(self) -> int:
        """M."""

    def n_robots(self, bodies: Any) -> int:
        """Return N."""
        return bodies.poses.shape[-2] - self.n_boxes

    def poses(self, bodies: Any) -> Float[Array, "*B N 3"]:
        """See `Engine.poses`."""
        return bodies.poses[..., : self.n_robots(bodies), :]

    def boxes(self, bodies: Any) -> Float[Array, "*B M 3"]:
        """See `Engine.boxes`."""
        return bodies.poses[..., self.n_robots(bodies) :, :]


def with_boxes(of_robots: Shaped[Array, "*B N"], n_boxes: int) -> Shaped[Array, "*B NM"]:
    """Return flags of robots with those of boxes after them, which are all present."""
    xp = array_module(of_robots)
    return xp.concatenate([of_robots, xp.ones((*of_robots.shape[:-1], n_boxes), bool)], axis=-1)


def set_points(
    phase: Phase, poses: Float[Array, "*B NM 3"], n_robots: int
) -> Float[Array, "*B NM 3"]:
    """Return the velocities that the drives of robots and boxes hold in a phase which begins at
    these poses."""
    xp, robots = array_module(poses), phase.velocity(poses[..., :n_robots, :])
    boxes = xp.zeros_like(poses[..., n_robots:, :]) if phase.boxes is None else phase.boxes
    return xp.concatenate([robots, boxes], axis=-2) if boxes.size else robots


StepBodies = Callable[[Any, Array, int, Array, Array], tuple[Any, Array, Array]]
"""Takes the physics steps of a phase: bodies, set points of their drives (*B, N, 3) [mm/s, mm/s,
rad/s], number of steps, worlds that take them (*B,), pairs in contact so far -> bodies, pairs in
contact, bits of `FaultKind` (*B,)."""


def take_phases(
    bodies: Any,
    phases: Sequence[Phase],
    is_running: Bool[Array, "*B"],
    walls: Array,
    robot: Robots,
    n_robots: int,
    step_bodies: StepBodies,
) -> Motion:
    """Take the steps of one phase after the other, as `Engine.move` must; a fault ends those of its
    world.

    Args:
        bodies: a named tuple of arrays or None, the first axes those of worlds; has `poses` and
            `is_present`.
        phases: what the robots do.
        is_running: which worlds move.
        walls: see `utils.walls.half_planes` [mm].
        robot: its geometry.
        n_robots: N; bodies beyond them have no drives.
        step_bodies: takes the steps of a phase.
    """
    xp = array_module(bodies.poses)
    moved, fault = bodies, xp.zeros(is_running.shape, xp.int32)
    touching = xp.zeros((*is_running.shape, robot.most_partners, n_robots), xp.int32)
    for phase in phases:
        targets, runs = set_points(phase, moved.poses, n_robots), is_running & (fault == 0)
        moved, touching, failure = step_bodies(moved, targets, phase.n_substeps, runs, touching)
        fault = fault | failure
    return finish_motion(bodies, moved, touching, fault, is_running, walls)


def finish_motion(
    bodies: Any, moved: Any, touching: Array, fault: Array, is_running: Array, walls: Array
) -> Motion:
    """Outcome of a motion to `moved`: robots that got lost are faults too, and worlds with faults
    keep their bodies.

    Args: as for `take_phases`; `fault` is what occurred on the way.
    """
    xp = array_module(bodies.poses)
    lost, robot = find_lost(moved.poses, bodies.is_present, walls)
    fault = xp.where(is_running, fault | lost, 0).astype(xp.int32)
    keeps = ~is_running | (fault != 0)
    kept = (
        None if new is None else xp.where(keeps[(..., *[None] * (new.ndim - keeps.ndim))], old, new)
        for old, new in zip(bodies, moved, strict=True)
    )
    return Motion(type(bodies)(*kept), touching, fault, robot)


class Engine(ABC, Generic[Bodies]):
    """Rigid-body physics and light of worlds with N robots each. Units: mm, mg, s, rad.

    An engine of your own derives from this class, or from `CompiledEngine`, has an attribute
    `robot`, and writes the four methods; `take_phases` and `sensors.links.find_links` help with two
    of them.

    An engine acts on one world, and is mapped over worlds by `jax.vmap`, or on B worlds at once,
    and all arrays have a leading axis; `*B` stands for either.
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
            bodies: where the robots are.
            emits: (*B, N) bool, which robots send light, or the power of their LEDs, from 0 to 1;
                dark ones still stand in the way.
            is_running: which worlds need an answer; that of the others is undefined.
        """

    @abstractmethod
    def move(
        self, bodies: Bodies, phases: Sequence[Phase], is_running: Bool[Array, "*B"]
    ) -> Motion:
        """Take the physics steps of some phases, one after the other.

        A world that does not run, or in which a fault occurs, keeps its bodies.
        """

    def boxes(self, bodies: Bodies) -> Float[Array, "*B M 3"] | None:
        """Return x, y [mm] and yaw [rad] of the boxes (`ArenaConfig.boxes`), yaw not wrapped; None
        without boxes."""
        return None


def boxes_of(engine: Engine, bodies: Any) -> Float[Array, "*B M 3"] | None:
    """Return x, y [mm] and yaw [rad] of the boxes; None where there are none."""
    boxes = engine.boxes(bodies)
    return boxes if boxes is not None and boxes.shape[-2] else None


Mapping = Literal["batch", "vmap", "in turn"]
"""How a compiled program goes through its worlds: the engine acts on all at once, or on one, and is
mapped over them, or computes one after the other."""


class CompiledEngine(Engine[Bodies]):
    """An engine that acts inside programs compiled by JAX; a pytree."""

    @abstractmethod
    def mapping(self, platform: str) -> Mapping:
        """Return how a program for devices of this platform goes through its worlds."""
