"""MJCF files of robots: their required parts, and the robots that they describe."""

import math
import re
from importlib.resources import files
from itertools import accumulate, combinations
from pathlib import Path
from types import NoneType
from typing import Any
from xml.parsers.expat import ExpatError

import mujoco
import numpy as np

from iswarm_mj.engines.mujoco_library import keep_no_log
from iswarm_mj.engines.plain_mjcf import check_plain
from iswarm_mj.geometry.robot import SIDES, Mixed, Point, Robot, RobotFile, Robots, Sides
from iswarm_mj.sensors.messages import MAX_LEDS
from iswarm_mj.utils.constraints import check, check_kind
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.files import check_file

MIN_LEDS = 2

JOINTS = (mujoco.mjtJoint.mjJNT_SLIDE, mujoco.mjtJoint.mjJNT_SLIDE, mujoco.mjtJoint.mjJNT_HINGE)
"""Types of a robot's joints x, y and yaw."""

_LISTS_OF_PARTS = {"body": "bodies", "joint": "joints", "geom": "geoms", "site": "sites"}
"""Attribute of MuJoCo's specification that lists the parts of each type."""

_REQUIRED_PARTS = {
    "body": ["robot", "visual"],
    "joint": ["x", "y", "yaw"],
    "geom": ["hull", "substrate"],
    "site": ["probe_tip"],
}
"""Names of the parts that every robot has, beside the sites of its optics."""

_OPTICS_OF_SIDE = (("led", ""), ("photodiode", "a"), ("photodiode", "b"))
"""Texts before and after a side's number in the names of its sites."""

_UNSUPPORTED_PARTS = {
    "joint stiffness": ("jnt_stiffness", "jnt_stiffnesspoly"),
    "joint limits": ("jnt_limited",),
    "friction loss": ("dof_frictionloss",),
    "damping that grows with speed": ("dof_dampingpoly",),
    "equality constraints": ("neq",),
    "tendons": ("ntendon",),
    "actuators": ("nu",),
    "contact pairs": ("npair",),
    "contact exclusions": ("nexclude",),
    "plugins": ("nplugin",),
}
"""Parts that no engine simulates, with the attributes of MuJoCo's model that are not 0 then."""

_SAME_DIRECTION = 1e-6
"""Difference of components below which two unit vectors have the same direction."""

_ROUNDING = 1e-9
"""Components of axes [1], and overhang of sites [mm], that are due to rounding alone."""


def models_directory() -> Path:
    """Return the directory of the MJCF files: in an installed package, or beside a checkout's."""
    package = Path(str(files("iswarm_mj")))
    candidates = (package / "models", package.parent / "models")
    return next(candidate for candidate in candidates if candidate.is_dir())


def as_robot_file(robot_file: Any) -> Path | tuple[str, ...] | None:
    """Return the file or files that a user gives, see `RobotFile`, with absolute paths.

    Raises:
        ConfigError: it is something else, or the number of robots of a kind is missing or zero.
    """
    if not isinstance(robot_file, tuple | list):
        check_kind("robot_file", robot_file, (Path, str, NoneType))
        return None if robot_file is None else Path(robot_file).absolute()

    example = "a.xml:200 b.xml:80"
    form = f"a file, or FILE:ROBOTS with at least one robot for each of several kinds, as {example}"
    stated = " ".join(map(str, robot_file)) or "none"
    is_complete = len(robot_file) > 0 and all(map(_states_number, robot_file))
    check("robot_file", stated, form, is_complete)
    return tuple(str(Path(word).absolute()) for word in robot_file)


def _states_number(word: Any) -> bool:
    """Return whether a word is FILE:ROBOTS with at least one robot."""
    return isinstance(word, str) and re.fullmatch(r".+:0*[1-9]\d*", word) is not None


def files_of(robot_file: RobotFile) -> list[tuple[Path | None, int]]:
    """Return the file of each kind and the number of its robots, 0 where none is given."""
    if not isinstance(robot_file, tuple):
        return [(None if robot_file is None else Path(str(robot_file)), 0)]
    parts = [word.rpartition(":") for word in robot_file]
    return [(Path(path), int(number)) for path, _, number in parts]


def check_total(robot_file: RobotFile, n_robots: int) -> None:
    """Raise a ConfigError unless the numbers of robots, if they are given, add up."""
    total = sum(number for _, number in files_of(robot_file))
    constraint = f"as many as the kinds of `robot_file` have together, {total}"
    check("n_robots", n_robots, constraint, total in (0, n_robots))


def read_robots(robot_file: RobotFile) -> Robots:
    """Read geometry and mass of the robots of a swarm; see `read_robot`, also for errors."""
    paths, sizes = zip(*files_of(robot_file), strict=True)
    kinds = tuple(map(read_robot, paths))
    if len(kinds) == 1:
        return kinds[0]
    return Mixed(kinds, tuple(accumulate(sizes[:-1], initial=0)))


def robot_spec(path: Path | None = None) -> mujoco.MjSpec:
    """Parse a robot's file; meshes that are not where it says are taken from `models/meshes`.

    Args:
        path: MJCF file with the bodies, geoms, joints and sites of `models/robot.xml`, by default
            that file.

    Raises:
        UserError: the file cannot be read, or something is missing.
    """
    default_path = models_directory() / "robot.xml"
    path = default_path if path is None else path
    keep_no_log()
    try:
        check_file(path)
        check_plain(path)
        spec = mujoco.MjSpec.from_file(str(path))
        present = _names_of_parts(spec)
        _check_referenced_files(spec, path.parent)
    except (ValueError, RuntimeError, OSError, ExpatError) as error:
        why = "there is none" if isinstance(error, FileNotFoundError) else _one_line(error)
        fact = f"the robot's file {path} cannot be read as MJCF ({why})"
        raise UserError(f"{fact}; give a copy of models/robot.xml.") from None

    missing = []
    for kind, name in _required_parts(spec):
        if name not in present[kind]:
            missing.append(f"{kind} {name}")
    if missing:
        fact = f"the robot's file {path} lacks {', '.join(missing)}"
        raise UserError(f"{fact}; name its parts as models/robot.xml does.")

    for mesh in spec.meshes:
        is_where_stated = (path.parent / spec.meshdir / mesh.file).exists()
        shipped = default_path.parent / "meshes" / Path(mesh.file).name
        if not is_where_stated and shipped.exists():
            mesh.file = str(shipped.absolute())
    return spec


def _names_of_parts(spec: mujoco.MjSpec) -> dict[str, set[str]]:
    """Return the names of the parts of each type."""
    names = {}
    for kind, attribute in _LISTS_OF_PARTS.items():
        names[kind] = {part.name for part in getattr(spec, attribute)}
    return names


def _required_parts(spec: mujoco.MjSpec) -> list[tuple[str, str]]:
    """Return type and name of the parts that a robot with these sites must have."""
    parts = [(kind, name) for kind, names in _REQUIRED_PARTS.items() for name in names]
    return parts + [("site", name) for name in _required_optics(spec)]


def _check_referenced_files(spec: mujoco.MjSpec, folder: Path) -> None:
    """Check the files that a robot's file names, where they exist.

    Args:
        spec: specification of the robot.
        folder: folder of the robot's file.

    Raises:
        UserError: a name is no text, or the file is not a plain one.
    """
    meshes = folder / spec.meshdir
    textures = folder / spec.texturedir
    paths = [meshes / mesh.file for mesh in spec.meshes if mesh.file]
    for texture in spec.textures:
        paths += [textures / name for name in (texture.file, *texture.cubefiles) if name]
    paths += [folder / skin.file for skin in spec.skins if skin.file]
    for path in paths:
        if path.exists():
            check_file(path)


def without_visual(spec: mujoco.MjSpec) -> mujoco.MjSpec:
    """Remove all parts that are only seen from a robot's specification, and return it."""
    spec.delete(spec.body("visual"))
    for mesh in list(spec.meshes):
        spec.delete(mesh)
    return spec


def read_robot(path: Path | None = None) -> Robot:
    """Read a robot's geometry and mass from its MJCF file.

    The sites of LEDs and photodiodes stand a little off the hull; light starts and ends on the
    hull's surface, where their optical axes cross it.

    Args:
        path: see `robot_spec`.

    Raises:
        UserError: the file cannot be read, lacks something, or describes a robot that cannot be
            simulated.
    """
    spec = robot_spec(path)
    path = models_directory() / "robot.xml" if path is None else path
    try:
        model = without_visual(spec).compile()
    except (ValueError, RuntimeError) as error:
        why = _one_line(error)
        raise UserError(f"the robot's file {path} cannot be compiled ({why}).") from None
    _check_model(model, path)

    n_sides = sum(kind == "led" for kind, _ in _numbered_sites(spec))
    sites = [_sites_of_side(side) for side in range(n_sides)]
    sides = _read_sides(model, sites, path)

    # Positions on the hull.
    leds = []
    photodiodes = []
    half_edges = tuple(model.geom("hull").size.tolist())
    axes = zip(sides.leds, sides.photodiodes, strict=True)
    for (led, first, second), (led_axis, axis) in zip(sites, axes, strict=True):
        leds.append(_on_hull(model, led, led_axis, half_edges, path))
        first_position = _on_hull(model, first, axis, half_edges, path)
        second_position = _on_hull(model, second, axis, half_edges, path)
        photodiodes.append((first_position, second_position))

    body = model.body("robot")
    tip_x, tip_y, tip_height = (body.pos + model.site("probe_tip").pos).tolist()
    return Robot(
        half_edges=half_edges,
        leds=tuple(leds),
        photodiodes=tuple(photodiodes),
        probe_tip=(tip_x, tip_y),
        tip_height=tip_height,
        mass=float(body.mass[0]),
        sides=sides,
    )


def _check_model(model: mujoco.MjModel, path: Path) -> None:
    """Check that a robot, without its visible parts, is one that all engines can simulate.

    Raises:
        UserError: it is not.
    """
    unsupported = []
    for part, attributes in _UNSUPPORTED_PARTS.items():
        if any(np.any(getattr(model, attribute)) for attribute in attributes):
            unsupported.append(part)
    if unsupported:
        raise UserError(
            f"the robot's file {path} has {', '.join(unsupported)}; a robot is a hull with sites "
            "on three joints that have damping alone: remove what else there is."
        )

    for requirement, is_met in _requirements(model):
        if not is_met:
            raise UserError(f"the robot's file {path} must have {requirement}; change it.")

    hull = model.geom("hull")
    body = model.body("robot")
    half_height = hull.size.tolist()[2]
    if hull.pos.any() or body.pos.tolist() != [0.0, 0.0, half_height]:
        raise UserError(
            f"the hull in {path} must stand on the floor with its centre at the robot's origin "
            f"(got body at {body.pos}, hull at {hull.pos} in it, half height {half_height}); "
            "change their pos."
        )


def _requirements(model: mujoco.MjModel) -> list[tuple[str, bool]]:
    """Return what all engines require of a robot without its visible parts, and if it is met."""
    no_rotation = [1.0, 0.0, 0.0, 0.0]
    body_is_upright = model.body_quat[1].tolist() == no_rotation
    hull_is_upright = model.geom_quat[0].tolist() == no_rotation
    has_joints = (
        tuple(model.jnt_type) == JOINTS
        and [model.joint(index).name for index in range(3)] == ["x", "y", "yaw"]
        and bool(np.allclose(model.jnt_axis, np.eye(3)))
        and not model.jnt_pos.any()
    )
    joints = "x and y, which slide along these axes, and yaw, a hinge about z"
    tip_height = model.body_pos[1, 2] + model.site("probe_tip").pos[2]
    return [
        ("no bodies but `robot`, outside the body `visual`", model.nbody == 2),
        ("no geoms but `hull`, outside the body `visual`", model.ngeom == 1),
        ("a box as hull", model.geom_type[0] == mujoco.mjtGeom.mjGEOM_BOX),
        ("a body and a hull that are not turned", body_is_upright and hull_is_upright),
        (f"the joints {joints}, in this order and no others", has_joints),
        (
            "joints without ref, so that they are zero where the robot stands in its file",
            not model.qpos0.any(),
        ),
        ("a probe whose tip is above the floor", tip_height > 0),
    ]


def _numbered_sites(spec: mujoco.MjSpec) -> list[tuple[str, int]]:
    """Return kind and number of the sites of LEDs and photodiodes."""
    matches = [re.fullmatch(r"(led|photodiode)(\d+)[ab]?", site.name) for site in spec.sites]
    return [(match[1], int(match[2])) for match in matches if match]


def _required_optics(spec: mujoco.MjSpec) -> list[str]:
    """Return the names of the sites that LEDs and photodiodes must have.

    The highest number of an LED or a photodiode tells how many sides the robot has.

    Raises:
        UserError: it has too many.
    """
    highest = max([MIN_LEDS - 1, *(number for _, number in _numbered_sites(spec))])
    if highest >= MAX_LEDS:
        raise UserError(
            f"a robot has {MIN_LEDS} to {MAX_LEDS} LEDs, led0 to led{MAX_LEDS - 1}, since three "
            f"bits of a message are the LED's number (got number {highest})."
        )
    return [site for side in range(highest + 1) for site in _sites_of_side(side)]


def _sites_of_side(side: int) -> list[str]:
    """Return the names of the sites of a side's LED and two photodiodes."""
    return [f"{kind}{side}{suffix}" for kind, suffix in _OPTICS_OF_SIDE]


def _read_sides(model: mujoco.MjModel, sites: list[list[str]], path: Path) -> Sides:
    """Read the directions of LEDs and photodiodes.

    Args:
        model: the robot.
        sites: names of the sites of each side, see `_sites_of_side`.
        path: the robot's file.

    Raises:
        UserError: two photodiodes of a side have different directions, or two sides the same.
    """
    axes = [[_optical_axis(model, site, path) for site in row] for row in sites]
    for (_, first, second), (_, first_axis, second_axis) in zip(sites, axes, strict=True):
        if not np.allclose(first_axis, second_axis, atol=_SAME_DIRECTION):
            fact = f"the sites {first} and {second} in {path} must look the same way"
            raise UserError(f"{fact}; change their xyaxes.")

    leds = [led for led, _, _ in axes]
    photodiodes = [first for _, first, _ in axes]
    _check_distinct("LEDs", leds, path)
    _check_distinct("pairs of photodiodes", photodiodes, path)
    return Sides(_snapped(leds), _snapped(photodiodes))


def _optical_axis(model: mujoco.MjModel, site: str, path: Path) -> Point:
    """Return the x axis of a site, a unit vector seen from above.

    Raises:
        UserError: it is not parallel to the floor.
    """
    matrix = np.zeros(9)
    mujoco.mju_quat2Mat(matrix, model.site(site).quat)
    x_axis = matrix[[0, 3, 6]]
    if abs(x_axis[2]) > _SAME_DIRECTION:
        raise UserError(f"site {site} in {path} must look along the floor (got x axis {x_axis}).")
    x, y = (0.0 if abs(part) < _ROUNDING else float(part) for part in x_axis[:2])
    return x / math.hypot(x, y), y / math.hypot(x, y)


def _check_distinct(kind: str, axes: list[Point], path: Path) -> None:
    """Raise a UserError if two LEDs, or two pairs of photodiodes, have the same direction."""
    for first, second in combinations(range(len(axes)), 2):
        if np.allclose(axes[second], axes[first], atol=_SAME_DIRECTION):
            raise UserError(
                f"the {kind} {first} and {second} in {path} look the same way, so that light "
                "could not be told apart by the side on which it falls; change their xyaxes."
            )


def _snapped(axes: list[Point]) -> tuple[Point, ...]:
    """Return the axes, exactly those of the paper's robot if they differ by rounding alone."""
    if len(axes) == len(SIDES) and np.allclose(axes, SIDES, atol=_SAME_DIRECTION):
        return SIDES
    return tuple(axes)


def _on_hull(
    model: mujoco.MjModel,
    site: str,
    axis: Point,
    half_edges: tuple[float, ...],
    path: Path,
) -> Point:
    """Return the point at which the optical axis of a site leaves the hull [mm].

    Args:
        model: the robot.
        site: name of the site.
        axis: unit vector.
        half_edges: those of the hull [mm].
        path: the robot's file.

    Raises:
        UserError: the site is inside the hull, or looks at it.
    """
    position = model.site(site).pos[:2].tolist()

    # How far the site is from the planes of the faces through which its axis may leave the hull.
    distances = []
    for k in (0, 1):
        outside = position[k] * math.copysign(1.0, axis[k]) - half_edges[k]
        distances.append(outside / abs(axis[k]) if axis[k] else -math.inf)

    # The axis leaves through the last of these planes that it crosses.
    distance = max(distances)
    face = distances.index(distance)
    along = 1 - face
    point = [float(position[k] - distance * axis[k]) for k in (0, 1)]
    point[face] = math.copysign(half_edges[face], axis[face])
    if distance < 0 or abs(point[along]) > half_edges[along] + _ROUNDING:
        raise UserError(
            f"site {site} in {path} must lie outside the hull and look away from it along an "
            f"outward normal or askew (got pos {position}, x axis {axis}); "
            "change its pos or xyaxes."
        )
    return point[0], point[1]


def _one_line(error: Exception) -> str:
    """Return the message of an error without line breaks."""
    return " ".join(str(error).split())
