"""The arena in MJX: capacities, model and template data, for `impl="jax"` and `impl="warp"`."""

import math
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from jaxtyping import Float

from iswarm_mj.config.swarm import SwarmConfig
from iswarm_mj.engines.arena import compile_arena
from iswarm_mj.engines.mjx.api import mjx, put_model
from iswarm_mj.geometry.obstacles import numbers, with_poses
from iswarm_mj.geometry.robot import RobotFile, Robots
from iswarm_mj.geometry.walls import area_of
from iswarm_mj.utils.arrays import Array
from iswarm_mj.utils.units import RD

_LINE_SEARCH = 8, 50  # iterations of conjugate gradients, and of Newton; more do not change the end of the search
_PARKED = -1000.0  # height of the robots that are absent [mm]


class ContactCapacity(NamedTuple):
    """Sizes of MJX's contact buffers for one world; MJX's arrays have fixed shapes."""

    pairs: int
    """Pairs of robots, boxes and obstacles that are compared (JAX)."""
    contacts: int
    """Contact points, each a constraint row, in one world."""


def contact_capacity(config: SwarmConfig, n_robots: int, factor: float = 1.0) -> ContactCapacity:
    """Buffers for N robots in their arena, by a rule that grows with N and with the density rho = N rd^2 / area.

    Pairs: 16 + N (0.4 + 1.2 rho). Contact points: 64 + N (0.7 + 2.4 rho), where a pair has up to four. That is about
    twice the most that type 1 showed in the first 60 steps at densities from 0.12 to 0.4. Swarms that jam, such as
    those whose robots hardly avoid each other, need more. A full buffer is a fault that names world and step.

    Each obstacle and each box has room for twice the robots that the circle around it has at this density, and for four
    contact points of each robot in a row along its edges.

    Args:
        config: the arena.
        n_robots: N.
        factor: times the rule.
    """
    arena, n_bodies = config.arena, n_robots + len(config.arena.boxes)
    density = n_robots / area_of(arena.corners)
    pairs, contacts = 16 + n_robots * (0.4 + 1.2 * density), 64 + n_robots * (0.7 + 2.4 * density)
    for *_, half_x, half_y, _ in (one[:5] for one in arena.standing):
        around = math.pi * (math.hypot(half_x, half_y) + 1) ** 2
        pairs += min(n_bodies, 8 + 2 * density * around)
        contacts += 8 + 16 * density * (half_x + half_y)
    most = n_bodies * (n_bodies - 1) // 2 + n_bodies * len(arena.obstacles)
    return ContactCapacity(min(math.ceil(factor * pairs), max(1, most)), math.ceil(factor * contacts))


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class MjxArena:
    """A compiled arena of N robots and M boxes; balls are points of the swarm's state. Units: mm, mg, s.

    Attributes:
        model: MJX's.
        data: MJX's, of one world at rest, from which each control step begins.
        servo_gain: (N + M, 3) drive force per speed: x, y [mg/s] and yaw [mg mm^2/s].
        obstacles: (O, 6) see `utils.obstacles.numbers` [mm].
        halves: (M, 2) half edges of the boxes [mm].
        geoms: (N + M + O,) geoms of robots, boxes and obstacles.
        near: gap of the spheres around two of these beyond which they cannot touch [mm].
        n_robots: N.
        impl: "jax" or "warp".
        capacity: of the buffers for contacts.
        walls: (W, 3) see `utils.walls.half_planes` [mm].
        robot: geometry and mass of the robots.
    """

    model: mjx.Model
    data: mjx.Data
    servo_gain: Array
    obstacles: Array
    halves: Array
    geoms: Array
    near: Array
    walls: Array
    n_robots: int = field(metadata={"static": True})
    impl: str = field(metadata={"static": True})
    capacity: ContactCapacity = field(metadata={"static": True})
    robot: Robots = field(metadata={"static": True})

    def hulls(self, poses: Float[Array, "N 3"]) -> Float[Array, "N 6"]:
        """Return robots as boxes, see `utils.obstacles.numbers` [mm]."""
        halves = jnp.asarray(self.robot.each("half_edges", self.n_robots))[:, :2]
        return with_poses(jnp.zeros((0, 6), poses.dtype), poses, halves)


def compile_mjx_arena(
    config: SwarmConfig,
    n_robots: int,
    impl: str,
    n_worlds: int,
    capacity: ContactCapacity | None = None,
    iterations: int = 100,
    robot_file: RobotFile = None,
) -> MjxArena:
    """Compile the arena for MJX.

    Args:
        config: sizes of arena, dump and dust areas; time step.
        n_robots: N.
        impl: "jax" or "warp".
        n_worlds: worlds on one device; Warp's contact buffer is shared by all of them.
        capacity: of the buffers for contacts of one world, by default `contact_capacity(config, n_robots)`.
        iterations: of the contact solver at most, 100 for MuJoCo's own result.
        robot_file: MJCF file of a robot, by default `models/robot.xml`; or those of several kinds.
    """
    room = contact_capacity(config, n_robots) if capacity is None else capacity

    def tune(spec: mujoco.MjSpec) -> None:
        _tune(spec, impl, room, iterations)

    arena = compile_arena(config, n_robots, np.zeros(0), tune=tune, robot_file=robot_file)
    geoms = np.concatenate([arena.hull, arena.obstacles])
    own = jax.local_devices()[0]  # MJX would take the first of all hosts
    rows = room.contacts + 5 * len(config.arena.boxes)  # of friction
    sizes: Any = {} if impl == "jax" else {"naconmax": room.contacts * n_worlds, "njmax": rows}
    return MjxArena(
        model=put_model(arena.model, impl, own),
        data=mjx.make_data(arena.model, own, impl, **sizes),
        servo_gain=jnp.asarray(arena.servo_gain, jnp.float32),
        obstacles=jnp.asarray(numbers(config.arena.obstacles, RD), jnp.float32),
        halves=jnp.asarray(numbers(config.arena.boxes, RD)[:, 4:], jnp.float32),
        geoms=jnp.asarray(geoms),
        near=jnp.float32(_largest_gap(arena.model, geoms)),
        walls=jnp.asarray(arena.planes, jnp.float32),
        n_robots=n_robots,
        impl=impl,
        capacity=room,
        robot=arena.robot,
    )


def without_absent(model: mjx.Model, is_present: Array) -> mjx.Model:
    """Model whose bodies that are not present wait deep under the floor, each at a height of its own."""
    depth = _PARKED - 10.0 * jnp.arange(len(is_present))
    height = jnp.where(is_present, model.body_pos[1:, 2], depth)
    return model.replace(body_pos=model.body_pos.at[1:, 2].set(height))


def _tune(spec: mujoco.MjSpec, impl: str, capacity: ContactCapacity, iterations: int) -> None:
    """Options that suit MJX: sparse inertia, and conjugate gradients, since its Newton solvers are dense.

    The friction of boxes with the floor takes Newton's method: gradients end up to 0.5 mm off in single precision.
    """
    spec.option.jacobian = mujoco.mjtJacobian.mjJAC_SPARSE
    rubs = any(joint.frictionloss for joint in spec.joints)
    spec.option.solver = mujoco.mjtSolver.mjSOL_NEWTON if rubs else mujoco.mjtSolver.mjSOL_CG
    spec.option.iterations, spec.option.ls_iterations = iterations, _LINE_SEARCH[rubs]
    unknown_to_warp = mujoco.mjtDisableBit.mjDSBL_MIDPHASE, mujoco.mjtDisableBit.mjDSBL_AUTORESET
    spec.option.disableflags &= ~sum(int(flag) for flag in unknown_to_warp)
    if impl == "warp":
        spec.option.tolerance = 1e-8
        # Without, two boxes get contacts from a search in single precision that at times finds a wrong one.
        spec.option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_NATIVECCD)
        # Weight does not act on planar joints, and Warp compares each body with each joint to compensate it.
        spec.option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_GRAVITY)
    else:
        # Ends where a step lowers the cost by no more than rounding; with 1e-6 jams end up to 0.2 mm off, as quickly.
        spec.option.tolerance = 1e-9
        spec.add_numeric(name="max_geom_pairs", data=[capacity.pairs], size=1)
        spec.add_numeric(name="max_contact_points", data=[capacity.contacts], size=1)


def _largest_gap(model: mujoco.MjModel, geoms: np.ndarray) -> float:
    """Largest gap of the spheres around two upright boxes that touch, seen from above [mm]; see `MjxArena.near`."""
    around, half = model.geom_rbound[geoms], np.hypot(*model.geom_size[geoms, :2].T)
    lifted = model.geom_pos[geoms, 2] + model.body_pos[model.geom_bodyid[geoms], 2]
    apart = np.hypot(half[:, None] + half, lifted[:, None] - lifted)
    return float((apart - around[:, None] - around).max())
