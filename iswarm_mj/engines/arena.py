"""The arena with its robots and balls, composed from the MJCF files in `models/`.

Configurations give lengths in rd, robot diameters, or m; the arena's are in mm.
"""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import mujoco
import numpy as np
from jaxtyping import Float, Int

from iswarm_mj.config.static import StaticDrive
from iswarm_mj.config.swarm import SwarmConfig
from iswarm_mj.engines.base import TURN_PARTS
from iswarm_mj.engines.robot_file import (
    JOINTS,
    files_of,
    models_directory,
    read_robot,
    read_robots,
    robot_spec,
    without_visual,
)
from iswarm_mj.engines.settings import REFINEMENT
from iswarm_mj.geometry.obstacles import HEAVIEST, Box, mean_distance, numbers
from iswarm_mj.geometry.robot import RobotFile, Robots
from iswarm_mj.geometry.walls import in_mm
from iswarm_mj.utils.arrays import Array, array_module
from iswarm_mj.utils.units import RD, mg_from_kg, mm_from_m, mm_from_rd

_BYTES_OF_ARENA = 16 * 2**20
_BYTES_PER_BODY = 200 * 2**10
"""Memory of a world for contacts and constraints: of the arena, and more for each robot or box."""

_MARGIN = 1.5
"""Margin of contacts in longest ways of a corner in a time step, see `contact_margin`."""
_PUSH = 0.03
"""Share of the way to the margin by which bodies that touch are pushed apart in a time step."""
_IMPEDANCE = 0.99
"""Impedance of surfaces that touch."""
_POWER = 4.0
"""Power of the way from the margin with which the impedance grows."""

_BOX_COLOUR = [0.54, 0.43, 0.31, 1.0]

_CONTACT_ATTRIBUTES = (
    "contype",
    "conaffinity",
    "condim",
    "group",
    "solref",
    "solimp",
    "solmix",
    "priority",
    "margin",
    "gap",
)
"""Attributes of a geom that say what it touches, and how hard its contacts are."""

_LOOK_OF_MATERIAL = (
    "rgba",
    "specular",
    "shininess",
    "emission",
    "metallic",
    "roughness",
    "reflectance",
)


class ArenaModel(NamedTuple):
    """Compiled arena with the places of its N robots, M boxes and K balls in MuJoCo's arrays.

    Units: mm, mg, s.
    """

    model: mujoco.MjModel
    n_robots: int
    """N; M boxes come after the robots."""
    hull: np.ndarray
    """(N + M,) geom ids of the hulls of robots and boxes."""
    body: np.ndarray
    """(N + M,) body ids of robots and boxes."""
    walls: np.ndarray
    """(W,) geom ids of the walls."""
    planes: np.ndarray
    """(W, 3) half planes of the walls, see `geometry.walls.half_planes` [mm]."""
    half_extent: float
    """Half the edge of the square around the arena [mm]."""
    obstacles: np.ndarray
    """(O,) geom ids of the obstacles."""
    qpos: np.ndarray
    """(N + M, 3) addresses of x, y, yaw in qpos, and in qvel."""
    mocap: np.ndarray
    """(K,) mocap ids of the balls."""
    servo_gain: np.ndarray
    """(N + M, 3) drive force per speed: x, y [mg/s] and yaw [mg mm^2/s]; 0 without a drive."""
    robot: Robots
    """Geometry and mass of the robots of the swarm."""
    kind: np.ndarray
    """(N,) index of each robot's kind in `robot.kinds`."""
    refinement: int
    """Time steps of the model in a physics step of the drive's configuration."""


class _Template(NamedTuple):
    """Part of which the arena contains several copies."""

    spec: mujoco.MjSpec
    body: str
    """Name of the body to copy."""
    materials: dict[str, str]
    """Name of the shared material of each of its geoms, see `_share_materials`."""


def arena_spec(
    config: SwarmConfig,
    kind: Int[np.ndarray, "N"],
    ball_radius: np.ndarray,
    *,
    visual: bool,
    robot_file: RobotFile = None,
    refinement: int = REFINEMENT,
) -> mujoco.MjSpec:
    """Compose the arena of robots robot0/, robot1/ ..., boxes box0/ ... and balls ball0/ ....

    Args:
        config: sizes of arena, dump and dust areas; boxes and obstacles.
        kind: index of each robot's kind among the files.
        ball_radius: (K,) radii of the balls [m].
        visual: keep the robots' visible parts; without them the physics is the same and faster.
        robot_file: MJCF file of a robot, by default `models/robot.xml`; or those of several kinds.
        refinement: time steps of the model in a physics step of the drive's configuration.
    """
    spec = mujoco.MjSpec.from_file(str(models_directory() / "arena.xml"))
    _lay_out(spec, config)
    spec.option.timestep = config.drive.timestep / refinement
    spec.copy_during_attach = True
    spec.memory = _BYTES_OF_ARENA + (len(kind) + len(config.arena.boxes)) * _BYTES_PER_BODY
    circumradius = read_robots(robot_file).circumradius
    margin = contact_margin(config.drive, circumradius, refinement)
    _tune_contacts(spec, spec.option.timestep, margin)

    paths = [path for path, _ in files_of(robot_file)]
    templates = [
        _robot_template(spec, path, number, margin=margin, visual=visual)
        for number, path in enumerate(paths)
    ]
    for robot_index, kind_index in enumerate(kind.tolist()):
        _attach(spec, f"robot{robot_index}/", templates[kind_index])

    hull = templates[0].spec.geom("hull")
    for box_index, box in enumerate(config.arena.boxes):
        _add_box(spec, f"box{box_index}/", box, hull)

    ball = _ball_template(spec)
    for ball_index, radius in enumerate(mm_from_m(ball_radius)):
        ball.spec.geom("ball").size[0] = radius
        _attach(spec, f"ball{ball_index}/", ball)
    return spec


def compile_arena(
    config: SwarmConfig,
    n_robots: int | None,
    ball_radius: np.ndarray,
    *,
    visual: bool = False,
    tune: Callable[[mujoco.MjSpec], None] | None = None,
    robot_file: RobotFile = None,
    refinement: int = REFINEMENT,
) -> ArenaModel:
    """Compile the arena and find its robots, boxes and balls.

    Args:
        config: sizes of arena, dump and dust areas; boxes and obstacles.
        n_robots: number of robots; None for one of each kind, for engines that read only constants
            of the compiled model.
        ball_radius: (K,) radii of the balls [m].
        visual: keep the robots' visible parts; without them the physics is the same and faster.
        tune: changes the composed arena before it is compiled.
        robot_file: MJCF file of a robot, by default `models/robot.xml`; or those of several kinds.
        refinement: time steps of the model in a physics step of the drive's configuration.
    """
    robot = read_robots(robot_file)
    kind = np.arange(len(robot.kinds)) if n_robots is None else robot.kind_of(n_robots)
    spec = arena_spec(
        config=config,
        kind=kind,
        ball_radius=ball_radius,
        visual=visual,
        robot_file=robot_file,
        refinement=refinement,
    )
    if tune is not None:
        tune(spec)
    model = spec.compile()

    # Robots and boxes have a hull and three joints each, whose names begin with that of the body.
    arena = config.arena
    prefixes = [f"robot{robot_index}/" for robot_index in range(len(kind))]
    prefixes += [f"box{box_index}/" for box_index in range(len(arena.boxes))]
    hull = _geom_ids(model, [prefix + "hull" for prefix in prefixes])
    qpos = np.array([_joint_addresses(model, prefix) for prefix in prefixes])

    # A drive is a damped joint that engines push with its damping times the target velocity
    # (`_tune_drive`). Slides and hinges have the same addresses in qpos and in qvel.
    servo_gain = model.dof_damping[qpos]

    balls = [model.body(f"ball{ball_index}/ball") for ball_index in range(len(ball_radius))]
    return ArenaModel(
        model=model,
        n_robots=len(kind),
        hull=hull,
        body=model.geom_bodyid[hull],
        walls=_geom_ids(model, [f"wall{index}" for index in range(len(arena.walls))]),
        planes=in_mm(arena.walls),
        half_extent=mm_from_rd(arena.size) / 2,
        obstacles=_geom_ids(model, [f"obstacle{index}" for index in range(len(arena.obstacles))]),
        qpos=qpos,
        mocap=np.array([ball.mocapid[0] for ball in balls], int),
        servo_gain=servo_gain,
        robot=robot,
        kind=kind,
        refinement=refinement,
    )


def _geom_ids(model: mujoco.MjModel, names: list[str]) -> np.ndarray:
    """Return the ids of the geoms with these names."""
    return np.array([model.geom(name).id for name in names], int)


def _joint_addresses(model: mujoco.MjModel, prefix: str) -> list[int]:
    """Return the addresses of a body's x, y and yaw in qpos."""
    return [model.joint(prefix + name).qposadr[0] for name in ("x", "y", "yaw")]


def _robot_template(
    spec: mujoco.MjSpec, path: Path | None, number: int, *, margin: float, visual: bool
) -> _Template:
    """Return the robot of a file, tuned to the arena's time step.

    Args:
        spec: the arena, which gets the robot's materials.
        path: MJCF file, None for `models/robot.xml`.
        number: index of the kind.
        margin: see `_tune_contacts` [mm].
        visual: keep the visible parts.
    """
    robot = robot_spec(path)
    if not visual:
        without_visual(robot)
        for site in robot.sites:
            robot.delete(site)
    timestep = spec.option.timestep
    geometry = read_robot(path)
    _tune_drive(robot, "", geometry.mass, geometry.yaw_inertia, timestep)
    _tune_contacts(robot, timestep, margin)
    robot.option.timestep = timestep
    return _Template(robot, "robot", _share_materials(robot, spec, f"kind{number}/"))


def _ball_template(spec: mujoco.MjSpec) -> _Template:
    """Return a ball for the arena, which gets its material."""
    ball = mujoco.MjSpec.from_file(str(models_directory() / "ball.xml"))
    ball.option.timestep = spec.option.timestep
    return _Template(ball, "ball", _share_materials(ball, spec, "ball/"))


def _lay_out(spec: mujoco.MjSpec, config: SwarmConfig) -> None:
    """Give floor, walls, dump, dust areas, obstacles and cameras their sizes and places."""
    arena = config.arena
    floor = spec.geom("floor")
    zoom = mm_from_rd(arena.size) / 2 / floor.size[0]

    # The floor lies under the rectangle around the arena, with one square of its texture a rd.
    lowest_corner = np.min(arena.corners, axis=0)
    highest_corner = np.max(arena.corners, axis=0)
    floor.size[:2] = mm_from_rd(highest_corner - lowest_corner) / 2
    floor.pos[:2] = mm_from_rd(highest_corner + lowest_corner) / 2
    spec.material("floor").texrepeat = (highest_corner - lowest_corner) / 2

    _add_walls(spec, mm_from_rd(np.array(arena.corners)), in_mm(arena.walls))

    spec.geom("dump").size[:2] = mm_from_rd(arena.dump_size) / 2
    for side, direction in (("west", -1), ("east", 1)):
        area = spec.geom(f"dust_{side}")
        area.pos[0] = direction * mm_from_rd(arena.dust_area_offset)
        area.size[:2] = mm_from_rd(arena.dust_area_size) / 2

    _add_obstacles(spec, numbers(arena.obstacles, RD))

    # Cameras look at the centre, and see as much of a larger arena from farther away.
    for name in ("above", "oblique"):
        spec.camera(name).pos *= zoom


def _add_walls(spec: mujoco.MjSpec, corners: np.ndarray, planes: np.ndarray) -> None:
    """Replace the walls of the file.

    Args:
        spec: the arena.
        corners: (W, 2) corners, anticlockwise; each wall leads from one to the next [mm].
        planes: (W, 3) half planes of the walls, see `geometry.walls.half_planes` [mm].
    """
    half_thickness, _, half_height = spec.geom("panel0").size.tolist()
    for geom in spec.geoms:
        if geom.name.startswith(("wall", "panel")):
            spec.delete(geom)

    next_corners = np.roll(corners, -1, axis=0)
    for index, (start, end, plane) in enumerate(zip(corners, next_corners, planes, strict=True)):
        outward = plane[:2]
        distance = plane[2]

        # The wall that robots touch: an endless plane whose normal points inwards.
        foot = outward * distance
        inward_rotation = _quaternion_of_normal(*-outward)
        _add_geom(spec, "wall", f"wall{index}", [*foot, 0.0], inward_rotation)

        # The panel that one sees: a slab outside of the wall, long enough to meet its neighbours.
        centre = (start + end) / 2 + half_thickness * outward
        half_length = np.hypot(*(end - start)) / 2 + 2 * half_thickness
        _add_geom(
            spec,
            "panel",
            f"panel{index}",
            pos=[*centre, half_height],
            quat=_quaternion_of_yaw(*outward),
            size=[half_thickness, half_length, half_height],
        )


def _add_obstacles(spec: mujoco.MjSpec, boxes: np.ndarray) -> None:
    """Add boxes (O, 6), see `geometry.obstacles.numbers`, with the contacts of walls [mm].

    They are as high as the walls' panels. As of a wall, one geom is touched and another one seen.
    """
    half_height = spec.geom("panel0").size[2]
    for index, (x, y, cos, sin, half_x, half_y) in enumerate(boxes):
        for name, default in ((f"obstacle{index}", "wall"), (f"block{index}", "panel")):
            _add_geom(
                spec,
                default,
                name,
                pos=[x, y, half_height],
                quat=_quaternion_of_yaw(cos, sin),
                type=mujoco.mjtGeom.mjGEOM_BOX,
                size=[half_x, half_y, half_height],
            )


def _add_box(spec: mujoco.MjSpec, prefix: str, box: Box, hull: mujoco.MjsGeom) -> None:
    """Add a box that moves on the joints of robots, with the contacts and height of their hulls.

    A box of mass 0 is driven: it is the heaviest box, with a drive as fast as a robot's.

    Args:
        spec: the arena.
        prefix: beginning of the names of its parts.
        box: half edges [rd], mass [kg] and friction coefficient, see `geometry.obstacles.Box`.
        hull: hull of a robot.
    """
    _, _, half_x, half_y, _, mass_in_kg, friction = box
    is_driven = mass_in_kg == 0
    mass = mg_from_kg(mass_in_kg or HEAVIEST)
    half_edges = mm_from_rd(np.array([half_x, half_y]))
    half_height = hull.size[2]
    friction_force = friction * mass * -spec.option.gravity[2]

    body = spec.worldbody.add_body(name=prefix + "box", pos=[0.0, 0.0, half_height])
    _add_box_joints(spec, body, prefix, half_edges, friction_force)
    if is_driven:
        a, b = half_edges
        yaw_inertia = mass * ((a * a + b * b) / 3)
        _tune_drive(spec, prefix, mass, yaw_inertia, spec.option.timestep)

    # One geom is touched, and another one is seen.
    shape: dict[str, Any] = {
        "type": mujoco.mjtGeom.mjGEOM_BOX,
        "size": [*half_edges, half_height],
    }
    contact = {name: getattr(hull, name) for name in _CONTACT_ATTRIBUTES}
    body.add_geom(name=prefix + "hull", mass=mass, **shape, **contact)
    body.add_geom(
        name=prefix + "block",
        mass=0.0,
        contype=0,
        conaffinity=0,
        group=2,
        rgba=_BOX_COLOUR,
        **shape,
    )


def _add_box_joints(
    spec: mujoco.MjSpec,
    body: mujoco.MjsBody,
    prefix: str,
    half_edges: np.ndarray,
    friction_force: float,
) -> None:
    """Add x, y and yaw of a box, and its friction with the floor.

    Joints have the friction along the axes, and tendons that along the diagonals. Together they
    yield at `friction_force` along the axes and the diagonals, and at up to 8 % more in between,
    whatever else pushes. About the vertical axis the friction is that of a box whose weight is
    spread evenly.

    Args:
        spec: the arena.
        body: the box.
        prefix: beginning of the names of joints and tendons.
        half_edges: (2,) half edges of the box [mm].
        friction_force: weight times coefficient of friction [nN].
    """
    # Along an axis its joint yields, and both tendons with sqrt(1/2) of theirs.
    force_per_direction = friction_force / (1.0 + math.sqrt(2.0))
    torque = friction_force * mean_distance(*half_edges)
    softness = {
        "solref_friction": [2 * spec.option.timestep, 1],
        "solimp_friction": [mujoco.mjMAXIMP, mujoco.mjMAXIMP, 1.0, 0.5, 1.0],
    }
    slide, _, hinge = JOINTS
    for name, kind, axis, yields_at in (
        ("x", slide, [1, 0, 0], force_per_direction),
        ("y", slide, [0, 1, 0], force_per_direction),
        ("yaw", hinge, [0, 0, 1], torque),
    ):
        body.add_joint(
            name=prefix + name,
            type=kind,
            axis=axis,
            frictionloss=yields_at,
            **softness,
        )

    if friction_force == 0:
        return
    for name, direction in (("left", 1.0), ("right", -1.0)):
        tendon = spec.add_tendon(name=prefix + name, frictionloss=force_per_direction, **softness)
        tendon.wrap_joint(prefix + "x", math.sqrt(0.5))
        tendon.wrap_joint(prefix + "y", direction * math.sqrt(0.5))


def _add_geom(
    spec: mujoco.MjSpec,
    default: str,
    name: str,
    pos: list[float],
    quat: list[float],
    **attributes: Any,
) -> None:
    """Add a geom of a default class of the file to the world."""
    class_of_geom = spec.find_default(default)
    spec.worldbody.add_geom(class_of_geom, name=name, pos=pos, quat=quat, **attributes)


def _quaternion_of_yaw(cos: float, sin: float) -> list[float]:
    """Return the rotation about the vertical axis by an angle with this cosine and sine."""
    yaw = math.atan2(sin, cos)
    return [math.cos(yaw / 2), 0.0, 0.0, math.sin(yaw / 2)]


def _quaternion_of_normal(x: float, y: float) -> list[float]:
    """Return the rotation that turns the z axis, a plane's normal, to the horizontal (x, y)."""
    half_angle = math.pi / 4
    return [math.cos(half_angle), -y * math.sin(half_angle), x * math.sin(half_angle), 0.0]


def _tune_drive(
    spec: mujoco.MjSpec,
    prefix: str,
    mass: float,
    yaw_inertia: float,
    timestep: float,
) -> None:
    """Make servos as fast as the time step allows: they reach a target velocity in one step.

    The gain is mass, or yaw inertia, over time step. Damping is explicit (eulerdamp is off), so
    that MuJoCo's contact solver knows what the servo will do; the limit of stability is twice
    this gain.

    Args:
        spec: has the joints.
        prefix: beginning of the joints' names.
        mass: [mg].
        yaw_inertia: [mg mm^2].
        timestep: [s].
    """
    for joint, inertia in (("x", mass), ("y", mass), ("yaw", yaw_inertia)):
        spec.joint(prefix + joint).damping[0] = inertia / timestep


def contact_margin(drive: StaticDrive, circumradius: float, refinement: int) -> float:
    """Return the distance of surfaces below which bodies have a contact [mm].

    It is `_MARGIN` times the longest way of a robot's corner in a time step. Two robots that meet
    come nearer by up to twice that way in a time step, and brake little near the margin. So they
    overlap most if they meet head on and a time step begins just within it.

    Args:
        drive: speeds and physics step.
        circumradius: distance of a robot's corners from its centre, of the largest robots [mm].
        refinement: time steps in a physics step.
    """
    walk = mm_from_rd(drive.step_length) / drive.walk_substeps
    turn = math.radians(drive.max_turn) / (drive.turn_substeps * TURN_PARTS)
    return _MARGIN * max(walk, turn * circumradius) / refinement


def _tune_contacts(spec: mujoco.MjSpec, timestep: float, margin: float) -> None:
    """Let contacts begin before bodies overlap.

    MuJoCo's impedance d grows from nearly 0 at the margin to `_IMPEDANCE` where surfaces touch.
    With a damping of one over the time step, two robots that meet flush come nearer by
    r / (1 + r), with r = (1 - d) / (6 d), of what they would without the contact: all of it at the
    margin, 72 % halfway, 27 % at three quarters of the way, next to nothing where they touch. So
    they brake as they come near. (They have four points, each of which yields by (1 - d) / d of
    MuJoCo's estimate of the inverse mass, 2/3 of the true one. A corner that meets a side has two
    points, and twice the r.)

    With a lower power the robots of a crowd brake so early that they finish later than with finer
    steps; with a higher one, so late that more of them overlap. Finer steps come with a smaller
    margin and make both less (docs/performance.md).

    The stiffness pushes bodies apart by up to `_PUSH` of the way that is left to the margin in a
    time step, also those that have no command. It holds robots apart that press upon each other,
    and takes back what turning and unfinished sweeps of a solver still let overlap. With 0.0125
    robots in jams of the planar engine overlap by up to 0.6 mm, with 0.03 by 0.14 mm.

    Args:
        spec: has the geoms.
        timestep: [s].
        margin: distance below which bodies have a contact [mm]. Each geom has half of it, since
            MuJoCo adds the margins of two geoms.
    """
    stiffness = _PUSH * (_IMPEDANCE / timestep) ** 2
    damping = _IMPEDANCE / timestep
    for geom in spec.geoms:
        if geom.contype or geom.conaffinity:
            geom.solref[:2] = [-stiffness, -damping]
            geom.solimp[:] = [mujoco.mjMINIMP, _IMPEDANCE, margin, mujoco.mjMAXIMP, _POWER]
            geom.margin = margin / 2


def solref_in_parts(solref: Float[Array, "K 2"], parts: Any) -> Float[Array, "K 2"]:
    """Return `solref` of K geoms, joints or tendons for a time step in parts.

    Two positive numbers are a time constant and a damping ratio, two negative ones stiffness and
    damping.

    Args:
        solref: for the undivided time step.
        parts: number of parts, which may be computed by a program of JAX.
    """
    xp = array_module(solref, parts)
    is_time = (solref > 0).all(axis=-1, keepdims=True)
    as_times = solref / xp.stack([parts, xp.ones_like(parts)])
    as_rates = solref * xp.stack([parts**2, parts])
    return xp.where(is_time, as_times, as_rates)


def _share_materials(child: mujoco.MjSpec, spec: mujoco.MjSpec, prefix: str) -> dict[str, str]:
    """Move the child's materials to the arena; return the material's name of each of its geoms.

    Attaching would copy the materials with every robot, which takes minutes for a thousand.
    """
    materials = {geom.name: geom.material and prefix + geom.material for geom in child.geoms}
    for material in list(child.materials):
        name = prefix + material.name
        if name in materials.values():
            look = {attribute: getattr(material, attribute) for attribute in _LOOK_OF_MATERIAL}
            spec.add_material(name=name, **look)
        child.delete(material)
    for geom in child.geoms:
        geom.material = ""
    return materials


def _attach(spec: mujoco.MjSpec, prefix: str, template: _Template) -> None:
    """Attach a copy of the template to the world, with the shared materials."""
    body = template.spec.body(template.body)
    spec.worldbody.add_frame().attach_body(body, prefix, "")
    for geom, material in template.materials.items():
        spec.geom(prefix + geom).material = material
