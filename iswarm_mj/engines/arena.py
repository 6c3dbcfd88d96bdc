"""The arena with its robots and balls, composed from the MJCF files in `models/`."""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import mujoco
import numpy as np
from jaxtyping import Int

from iswarm_mj.config.swarm import SwarmConfig
from iswarm_mj.engines.robot_file import (
    JOINTS,
    files_of,
    models_directory,
    read_robot,
    read_robots,
    robot_spec,
    without_visual,
)
from iswarm_mj.geometry.obstacles import HEAVIEST, Box, mean_distance, numbers
from iswarm_mj.geometry.robot import Robot, RobotFile, Robots
from iswarm_mj.geometry.walls import in_mm
from iswarm_mj.utils.units import RD, mg_from_kg, mm_from_m, mm_from_rd


class ArenaModel(NamedTuple):
    """A compiled arena, and where its N robots, M boxes and K balls are in MuJoCo's arrays. Units: mm, mg, s."""

    model: mujoco.MjModel
    n_robots: int
    """N; after the robots come M boxes."""
    hull: np.ndarray
    """(N + M,) geom ids of their hulls."""
    body: np.ndarray
    """(N + M,) body ids."""
    walls: np.ndarray
    """(W,) geom ids of the walls."""
    planes: np.ndarray
    """(W, 3) where they are, see `utils.walls.half_planes` [mm]."""
    extent: float
    """Half the edge of the square around them [mm]."""
    obstacles: np.ndarray
    """(M,) geom ids of the obstacles."""
    qpos: np.ndarray
    """(N + M, 3) addresses of x, y, yaw in qpos, and in qvel."""
    mocap: np.ndarray
    """(K,) mocap ids of the balls."""
    servo_gain: np.ndarray
    """(N + M, 3) drive force per speed: x, y [mg/s] and yaw [mg mm^2/s]; 0 without a drive."""
    robot: Robots
    """Geometry and mass of the robots of the swarm."""
    kind: np.ndarray
    """(N,) index in `robot.kinds` of each robot here."""
    refinement: int
    """Time steps of the model in a physics step of the drive's configuration."""


def arena_spec(
    config: SwarmConfig,
    kind: Int[np.ndarray, "N"],
    ball_radius: np.ndarray,
    visual: bool,
    robot_file: RobotFile = None,
    refinement: int = 1,
) -> mujoco.MjSpec:
    """Compose the arena.

    Args:
        config: sizes of arena, dump and dust areas; boxes, named box0/ and so on.
        kind: of the robots, which are named robot0/ and so on: index among the files.
        ball_radius: (K,) radii of the balls [m], named ball0/ and so on.
        visual: keep the robots' visible parts; without them the physics is the same and faster.
        robot_file: MJCF file of a robot, by default `models/robot.xml`; or those of several kinds.
        refinement: time steps of the model in a physics step of the drive's configuration.
    """
    directory = models_directory()
    spec = mujoco.MjSpec.from_file(str(directory / "arena.xml"))
    _lay_out(spec, config)
    spec.option.timestep = config.drive.timestep / refinement
    spec.copy_during_attach = True
    spec.memory = 16 * 2**20 + (len(kind) + len(config.arena.boxes)) * 200 * 2**10
    _tune_contacts(spec, spec.option.timestep)
    kinds = [_robot_of_kind(path, spec, number, visual) for number, (path, _) in enumerate(files_of(robot_file))]
    for i, number in enumerate(kind.tolist()):
        robot, looks = kinds[number]
        _attach(robot.body("robot"), spec, f"robot{i}/", looks)
    for k, box in enumerate(config.arena.boxes):
        _add_box(spec, f"box{k}/", box, kinds[0][0].geom("hull"))
    ball = mujoco.MjSpec.from_file(str(directory / "ball.xml"))
    ball.option.timestep = spec.option.timestep
    looks = _share_materials(ball, spec, "ball/")
    for k, radius in enumerate(mm_from_m(ball_radius)):
        ball.geom("ball").size[0] = radius
        _attach(ball.body("ball"), spec, f"ball{k}/", looks)
    return spec


def compile_arena(
    config: SwarmConfig,
    n_robots: int | None,
    ball_radius: np.ndarray,
    visual: bool = False,
    tune: Callable[[mujoco.MjSpec], None] | None = None,
    robot_file: RobotFile = None,
    refinement: int = 1,
) -> ArenaModel:
    """Compile the arena and find its robots and balls.

    Args: as for `arena_spec`; `n_robots` is the number of robots, None for one of each kind, and `tune` changes what it
    made.
    """
    robot = read_robots(robot_file)
    kind = np.arange(len(robot.kinds)) if n_robots is None else robot.kind_of(n_robots)
    spec = arena_spec(config, kind, ball_radius, visual, robot_file, refinement)
    if tune is not None:
        tune(spec)
    model = spec.compile()
    bodies = [*(f"robot{i}/" for i in range(len(kind))), *(f"box{k}/" for k in range(len(config.arena.boxes)))]
    qpos = [[model.joint(r + j).qposadr[0] for j in ("x", "y", "yaw")] for r in bodies]
    hull = np.array([model.geom(r + "hull").id for r in bodies])
    return ArenaModel(
        model=model,
        n_robots=len(kind),
        hull=hull,
        body=model.geom_bodyid[hull],
        walls=np.array([model.geom(f"wall{k}").id for k in range(len(config.arena.walls))]),
        planes=in_mm(config.arena.walls),
        extent=mm_from_rd(config.arena.size) / 2,
        obstacles=np.array([model.geom(f"obstacle{k}").id for k in range(len(config.arena.obstacles))], int),
        qpos=np.array(qpos),
        mocap=np.array([model.body(f"ball{k}/ball").mocapid[0] for k in range(len(ball_radius))], int),
        servo_gain=model.dof_damping[np.array(qpos)],
        robot=robot,
        kind=kind,
        refinement=refinement,
    )


def _robot_of_kind(
    path: Path | None, spec: mujoco.MjSpec, number: int, visual: bool
) -> tuple[mujoco.MjSpec, dict[str, str]]:
    """Robot of a file, to be attached to the arena, and the materials of its geoms; arguments as for `arena_spec`."""
    robot = robot_spec(path)
    if not visual:
        for unused in without_visual(robot).sites:
            robot.delete(unused)
    _tune_drive(robot, read_robot(path), spec.option.timestep)
    _tune_contacts(robot, spec.option.timestep)
    robot.option.timestep = spec.option.timestep
    return robot, _share_materials(robot, spec, f"kind{number}/")


def _lay_out(spec: mujoco.MjSpec, config: SwarmConfig) -> None:
    """Give floor, walls, dump, dust areas and the cameras the configured sizes and places."""
    arena, floor, edge = config.arena, spec.geom("floor"), mm_from_rd(config.arena.size) / 2
    zoom, low, high = edge / floor.size[0], np.min(arena.corners, axis=0), np.max(arena.corners, axis=0)
    floor.size[:2], floor.pos[:2] = mm_from_rd(high - low) / 2, mm_from_rd(high + low) / 2
    spec.material("floor").texrepeat = (high - low) / 2
    _add_walls(spec, mm_from_rd(np.array(arena.corners)), in_mm(arena.walls))
    spec.geom("dump").size[:2] = mm_from_rd(arena.dump_size) / 2
    for side, x in {"west": -1, "east": 1}.items():
        area = spec.geom(f"dust_{side}")
        area.pos[0] = x * mm_from_rd(arena.dust_area_offset)
        area.size[:2] = mm_from_rd(arena.dust_area_size) / 2
    _add_obstacles(spec, numbers(arena.obstacles, RD))
    for camera in ("above", "oblique"):
        spec.camera(camera).pos *= zoom


def _add_walls(spec: mujoco.MjSpec, corners: np.ndarray, planes: np.ndarray) -> None:
    """Put walls from each corner (W, 2) to the next [mm] in place of those of the file; panels are what one sees."""
    thick, _, height = spec.geom("panel0").size.tolist()
    for given in [geom for geom in spec.geoms if geom.name.startswith(("wall", "panel"))]:
        spec.delete(given)
    ends = zip(corners, np.roll(corners, -1, axis=0), planes, strict=True)
    for k, (corner, other, (x, y, distance)) in enumerate(ends):
        inwards = [math.cos(math.pi / 4), y * math.sin(math.pi / 4), -x * math.sin(math.pi / 4), 0.0]
        _add(spec, "wall", f"wall{k}", [x * distance, y * distance, 0.0], inwards)
        middle, length = (corner + other) / 2 + [thick * x, thick * y], np.hypot(*(other - corner)) / 2 + 2 * thick
        _add(spec, "panel", f"panel{k}", [*middle, height], _turn(y, x), size=[thick, length, height])


def _add_obstacles(spec: mujoco.MjSpec, boxes: np.ndarray) -> None:
    """Add boxes as high as the walls' panels, with the walls' contacts; what one sees is another geom, as of a wall."""
    height, box = spec.geom("panel0").size[2], mujoco.mjtGeom.mjGEOM_BOX
    for k, (x, y, c, s, half_x, half_y) in enumerate(boxes):
        for name, like in ((f"obstacle{k}", "wall"), (f"block{k}", "panel")):
            _add(spec, like, name, [x, y, height], _turn(s, c), type=box, size=[half_x, half_y, height])


_BOX = [0.54, 0.43, 0.31, 1.0]
"""Colour of boxes."""


def _add_box(spec: mujoco.MjSpec, prefix: str, box: Box, hull: mujoco.MjsGeom) -> None:
    """Add a box: on the joints of robots, with the contacts and the height of their hulls.

    One of mass 0 is the heaviest box with a drive as fast as a robot's, and without friction.

    The floor's friction is that of joints, and of tendons that slide along the diagonals: together they let go at the
    weight times the coefficient along the axes and the diagonals, at up to 8 % more in between, whatever else pushes.
    About the vertical axis it is that of a box whose weight is spread evenly. What one sees is another geom.
    """
    _, _, half_x, half_y, _, mass, friction = box
    is_driven, mass = mass == 0, mass or HEAVIEST
    (a, b), (slide, hinge) = mm_from_rd(np.array([half_x, half_y])), JOINTS[1:]
    grip = friction * mg_from_kg(mass) * -spec.option.gravity[2]
    soft = {
        "solref_friction": [2 * spec.option.timestep, 1],
        "solimp_friction": [mujoco.mjMAXIMP, mujoco.mjMAXIMP, 1.0, 0.5, 1.0],
    }
    each = grip / (1.0 + math.sqrt(2.0))
    body = spec.worldbody.add_body(name=prefix + "box", pos=[0.0, 0.0, hull.size[2]])
    for name, kind, axis in (("x", slide, [1, 0, 0]), ("y", slide, [0, 1, 0]), ("yaw", hinge, [0, 0, 1])):
        most = each if kind == slide else grip * mean_distance(a, b)
        joint = body.add_joint(name=prefix + name, type=kind, axis=axis, frictionloss=most, **soft)
        moved = mg_from_kg(mass) * (1.0 if kind == slide else (a * a + b * b) / 3)
        joint.damping[0] = is_driven * moved / spec.option.timestep
    for name, left in (("left", 1.0), ("right", -1.0)) if grip else ():
        tendon = spec.add_tendon(name=prefix + name, frictionloss=each, **soft)
        tendon.wrap_joint(prefix + "x", math.sqrt(0.5))
        tendon.wrap_joint(prefix + "y", left * math.sqrt(0.5))
    names = ("contype", "conaffinity", "condim", "group", "solref", "solimp", "solmix", "priority", "margin", "gap")
    same = {name: getattr(hull, name) for name in names}
    shape = {"type": mujoco.mjtGeom.mjGEOM_BOX, "size": [a, b, hull.size[2]]}
    body.add_geom(name=prefix + "hull", mass=mg_from_kg(mass), **shape, **same)
    body.add_geom(name=prefix + "block", mass=0.0, contype=0, conaffinity=0, group=2, rgba=_BOX, **shape)


def _add(spec: mujoco.MjSpec, like: str, name: str, pos: list[float], quat: list[float], **own: Any) -> None:
    """Add a geom of a class of the file to the world."""
    spec.worldbody.add_geom(spec.find_default(like), name=name, pos=pos, quat=quat, **own)


def _turn(sin: float, cos: float) -> list[float]:
    """Quaternion of a turn about the vertical axis."""
    yaw = math.atan2(sin, cos)
    return [math.cos(yaw / 2), 0.0, 0.0, math.sin(yaw / 2)]


def _tune_drive(spec: mujoco.MjSpec, robot: Robot, timestep: float) -> None:
    """Make the servos as fast as the time step allows: a target velocity is reached in one step.

    The gain is m / timestep, and the yaw inertia / timestep likewise. Damping is explicit (eulerdamp is off), so
    that MuJoCo's contact solver knows what the servo will do; the limit of stability is twice this gain.
    """
    for joint, moved in (("x", robot.mass), ("y", robot.mass), ("yaw", robot.yaw_inertia)):
        spec.joint(joint).damping[0] = moved / timestep


def _tune_contacts(spec: mujoco.MjSpec, timestep: float) -> None:
    """Make the contacts as quick as the time step allows: their time constant is two steps, the least by `refsafe`.

    How deep robots overlap then depends on how far they move in a step alone.
    """
    for geom in spec.geoms:
        if geom.contype or geom.conaffinity:
            geom.solref[0] = 2 * timestep


def _share_materials(child: mujoco.MjSpec, spec: mujoco.MjSpec, prefix: str) -> dict[str, str]:
    """Move the child's materials to `spec`, once for all its copies; return the material of each of its geoms.

    Attaching would copy them with every robot, which takes minutes for a thousand.
    """
    looks = {geom.name: geom.material and prefix + geom.material for geom in child.geoms}
    for material in list(child.materials):
        if prefix + material.name in looks.values():
            traits = ("rgba", "specular", "shininess", "emission", "metallic", "roughness", "reflectance")
            spec.add_material(name=prefix + material.name, **{trait: getattr(material, trait) for trait in traits})
        child.delete(material)
    for geom in child.geoms:
        geom.material = ""
    return looks


def _attach(body: mujoco.MjsBody, spec: mujoco.MjSpec, prefix: str, looks: dict[str, str]) -> None:
    """Attach a copy of `body` to the world, with the shared materials."""
    spec.worldbody.add_frame().attach_body(body, prefix, "")
    for geom, material in looks.items():
        spec.geom(prefix + geom).material = material
