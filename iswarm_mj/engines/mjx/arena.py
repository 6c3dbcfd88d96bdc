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
from iswarm_mj.engines.arena import compile_arena, solref_in_parts
from iswarm_mj.engines.mjx.api import mjx, put_model
from iswarm_mj.engines.settings import REFINEMENT
from iswarm_mj.geometry.obstacles import numbers, with_poses
from iswarm_mj.geometry.robot import RobotFile, Robots
from iswarm_mj.geometry.walls import area_of
from iswarm_mj.utils.arrays import Array
from iswarm_mj.utils.units import RD

_GRADIENT_LINE_SEARCH = 8
_NEWTON_LINE_SEARCH = 50
"""Iterations of the solvers' line searches; more do not change the end of the search."""

_FRICTION_ROWS = 5
"""Constraint rows for the friction of a box with the floor: three joints and two tendons."""

_PARKING_HEIGHT = -1000.0
_PARKING_DISTANCE = 10.0
"""Absent robots wait at this height under the floor, this far below each other [mm]."""


class ContactCapacity(NamedTuple):
    """Sizes of MJX's contact buffers for one world, whose shapes are fixed."""

    pairs: int
    """Pairs of robots, boxes and obstacles that are compared (JAX)."""
    contacts: int
    """Contact points, each a constraint row, in one world."""


def contact_capacity(config: SwarmConfig, n_robots: int, factor: float = 1.0) -> ContactCapacity:
    """Return buffers that grow with the number of robots N and their density rho = N rd^2 / area.

    Pairs: 16 + N (1 + 0.5 rho). Contact points: 64 + N (2 + 0.8 rho), where a pair has up to
    four. That is about 1.5 times the most that type 1 showed in the first 20 to 60 steps at
    densities from 0.12 to 0.4. Swarms that jam, such as those whose robots hardly avoid each
    other, need more. A full buffer is a fault that names world and step.

    Args:
        config: the arena.
        n_robots: N.
        factor: size of the buffers relative to the default.
    """
    arena = config.arena
    n_bodies = n_robots + len(arena.boxes)
    density = n_robots / area_of(arena.corners)  # robots per rd^2
    pairs = 16 + n_robots * (1.0 + 0.5 * density)
    contacts = 64 + n_robots * (2.0 + 0.8 * density)

    # Obstacles and boxes: twice the robots that the circle around one has at this density, and
    # four contact points of each robot in a row along its edges.
    for _, _, half_x, half_y, *_ in arena.standing:
        area_around = math.pi * (math.hypot(half_x, half_y) + 1) ** 2
        pairs += min(n_bodies, 8 + 2 * density * area_around)
        contacts += 8 + 16 * density * (half_x + half_y)

    pairs_of_bodies = n_bodies * (n_bodies - 1) // 2
    all_pairs = pairs_of_bodies + n_bodies * len(arena.obstacles)
    return ContactCapacity(
        pairs=min(math.ceil(factor * pairs), max(1, all_pairs)),
        contacts=math.ceil(factor * contacts),
    )


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class MjxArena:
    """Compiled arena of N robots and M boxes, without balls. Units: mm, mg, s.

    Attributes:
        model: MJX's model.
        data: MJX's data of one world at rest, from which each control step begins.
        servo_gain: (N + M, 3) drive force per speed: x, y [mg/s] and yaw [mg mm^2/s].
        obstacles: (O, 6) obstacles, see `geometry.obstacles.numbers` [mm].
        halves: (M, 2) half edges of the boxes [mm].
        geoms: (N + M + O,) geom ids of robots, boxes and obstacles.
        near: gap of the spheres around two of these beyond which they have no contact [mm].
        walls: (W, 3) half planes of the walls, see `geometry.walls.half_planes` [mm].
        n_robots: N.
        impl: implementation of MJX, "jax" or "warp".
        capacity: sizes of the contact buffers.
        robot: geometry and mass of the robots.
        refinement: time steps of the model in a physics step of the drive's configuration.
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
    refinement: int = field(metadata={"static": True})

    def hulls(self, poses: Float[Array, "N 3"]) -> Float[Array, "N 6"]:
        """Return robots at these poses as boxes, see `geometry.obstacles.numbers` [mm]."""
        half_edges = jnp.asarray(self.robot.each("half_edges", self.n_robots))[:, :2]
        no_obstacles = jnp.zeros((0, 6), poses.dtype)
        return with_poses(no_obstacles, poses, half_edges)


def compile_mjx_arena(
    config: SwarmConfig,
    n_robots: int,
    impl: str,
    n_worlds: int,
    capacity: ContactCapacity | None = None,
    iterations: int = 100,
    robot_file: RobotFile = None,
    refinement: int = REFINEMENT,
) -> MjxArena:
    """Compile the arena for MJX.

    Args:
        config: sizes of arena, dump and dust areas; time step.
        n_robots: N.
        impl: "jax" or "warp".
        n_worlds: worlds on one device; Warp's contact buffer is shared by all of them.
        capacity: sizes of the contact buffers of one world, by default
            `contact_capacity(config, n_robots)`.
        iterations: maximum of the contact solver, 100 for MuJoCo's own result.
        robot_file: MJCF file of a robot, by default `models/robot.xml`; or those of several kinds.
        refinement: time steps of the model in a physics step of the drive's configuration.
    """
    if capacity is None:
        capacity = contact_capacity(config, n_robots)

    def tune(spec: mujoco.MjSpec) -> None:
        _tune(spec, impl, capacity, iterations)

    arena = compile_arena(
        config=config,
        n_robots=n_robots,
        ball_radius=np.zeros(0),
        tune=tune,
        robot_file=robot_file,
        refinement=refinement,
    )
    geoms = np.concatenate([arena.hull, arena.obstacles])

    sizes: dict[str, Any] = {}
    if impl == "warp":
        sizes["naconmax"] = capacity.contacts * n_worlds
        sizes["njmax"] = capacity.contacts + _FRICTION_ROWS * len(config.arena.boxes)

    device = jax.local_devices()[0]  # by default, MJX takes the first device of all hosts
    return MjxArena(
        model=put_model(arena.model, impl, device),
        data=mjx.make_data(arena.model, device, impl, **sizes),
        servo_gain=jnp.asarray(arena.servo_gain, jnp.float32),
        obstacles=jnp.asarray(numbers(config.arena.obstacles, RD), jnp.float32),
        halves=jnp.asarray(numbers(config.arena.boxes, RD)[:, 4:], jnp.float32),
        geoms=jnp.asarray(geoms),
        near=jnp.float32(_largest_gap(arena.model, geoms)),
        walls=jnp.asarray(arena.planes, jnp.float32),
        n_robots=n_robots,
        impl=impl,
        capacity=capacity,
        robot=arena.robot,
        refinement=arena.refinement,
    )


def without_absent(model: mjx.Model, is_present: Array) -> mjx.Model:
    """Return the model with absent robots deep under the floor.

    Args:
        model: MJX's model, whose body 0 is the world.
        is_present: (N + M,) bool of robots and boxes.
    """
    parked = _PARKING_HEIGHT - _PARKING_DISTANCE * jnp.arange(len(is_present))
    height = jnp.where(is_present, model.body_pos[1:, 2], parked)
    return model.replace(body_pos=model.body_pos.at[1:, 2].set(height))


def in_parts(model: mjx.Model, parts: Array) -> mjx.Model:
    """Return the model with its time step in parts, in which drives and contacts are as quick.

    A drive's damping is its gain.
    """
    return model.replace(
        opt=model.opt.replace(timestep=model.opt.timestep / parts),
        dof_damping=model.dof_damping * parts,
        geom_solref=solref_in_parts(model.geom_solref, parts),
        dof_solref=solref_in_parts(model.dof_solref, parts),
        tendon_solref_fri=solref_in_parts(model.tendon_solref_fri, parts),
    )


def _tune(spec: mujoco.MjSpec, impl: str, capacity: ContactCapacity, iterations: int) -> None:
    """Set the options that suit MJX: sparse inertia, solver and its limits.

    Args:
        spec: the arena.
        impl: "jax" or "warp".
        capacity: sizes of the contact buffers.
        iterations: maximum of the contact solver.
    """
    # MJX's Newton solvers are dense, so they are for the friction of boxes with the floor alone:
    # there, conjugate gradients end up to 0.5 mm off in single precision.
    option = spec.option
    option.jacobian = mujoco.mjtJacobian.mjJAC_SPARSE
    option.iterations = iterations
    if any(joint.frictionloss for joint in spec.joints):
        option.solver = mujoco.mjtSolver.mjSOL_NEWTON
        option.ls_iterations = _NEWTON_LINE_SEARCH
    else:
        option.solver = mujoco.mjtSolver.mjSOL_CG
        option.ls_iterations = _GRADIENT_LINE_SEARCH

    unknown_to_warp = mujoco.mjtDisableBit.mjDSBL_MIDPHASE, mujoco.mjtDisableBit.mjDSBL_AUTORESET
    option.disableflags &= ~sum(int(flag) for flag in unknown_to_warp)
    if impl == "warp":
        option.tolerance = 1e-8
        # Warp's own search for the contacts of two boxes, in single precision, finds wrong ones
        # at times.
        option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_NATIVECCD)
        # Weight does not act on planar joints, and Warp compares each body with each joint to
        # compensate it.
        option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_GRAVITY)
    else:
        # The solver ends where a step lowers the cost by no more than rounding. With 1e-6 it takes
        # as long, and jams end up to 0.2 mm off.
        option.tolerance = 1e-9
        spec.add_numeric(name="max_geom_pairs", data=[capacity.pairs], size=1)
        spec.add_numeric(name="max_contact_points", data=[capacity.contacts], size=1)


def _largest_gap(model: mujoco.MjModel, geoms: np.ndarray) -> float:
    """Return the largest gap of the spheres around two upright boxes with a contact [mm].

    See `MjxArena.near`. The boxes are nearest at corners, seen from above, and may differ in
    height.
    """
    sphere_radius = model.geom_rbound[geoms]
    half_x, half_y, _ = model.geom_size[geoms].T
    reach = np.hypot(half_x, half_y) + model.geom_margin[geoms]
    height = model.geom_pos[geoms, 2] + model.body_pos[model.geom_bodyid[geoms], 2]

    # Of each geom with each.
    horizontal = np.add.outer(reach, reach)
    vertical = np.subtract.outer(height, height)
    gap = np.hypot(horizontal, vertical) - np.add.outer(sphere_radius, sphere_radius)
    return float(gap.max())
