"""Robots' files in MJCF: what they must contain, and the robots that they describe."""

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
_TYPES = {"body": "bodies", "joint": "joints", "geom": "geoms", "site": "sites"}
_NEEDED = {
    "body": ["robot", "visual"],
    "joint": ["x", "y", "yaw"],
    "geom": ["hull", "substrate"],
    "site": ["probe_tip"],
}
JOINTS = (mujoco.mjtJoint.mjJNT_SLIDE, mujoco.mjtJoint.mjJNT_SLIDE, mujoco.mjtJoint.mjJNT_HINGE)
"""Types of a robot's joints, x, y and yaw."""
_SAME = 1e-6  # components of unit vectors that differ by less look the same way


def models_directory() -> Path:
    """Return the directory of the MJCF files: inside an installed package, or beside it in a checkout."""
    package = Path(str(files("iswarm_mj")))
    return next(p for p in (package / "models", package.parent / "models") if p.is_dir())


def as_robot_file(given: Any) -> Path | tuple[str, ...] | None:
    """Return the file or the files that a user gives, see `RobotFile`, with absolute paths.

    Raises:
        ConfigError: it is something else, or the number of robots of a kind is missing or zero.
    """
    if not isinstance(given, tuple | list):
        check_kind("robot_file", given, (Path, str, NoneType))
        return None if given is None else Path(given).absolute()
    words = [word if isinstance(word, str) and re.fullmatch(r".+:0*[1-9]\d*", word) else None for word in given]
    form = "a file, or FILE:ROBOTS with at least one robot for each of several kinds, as a.xml:200 b.xml:80"
    check("robot_file", " ".join(map(str, given)) or "none", form, len(words) > 0 and None not in words)
    return tuple(str(Path(word).absolute()) for word in words if word)


def files_of(given: RobotFile) -> list[tuple[Path | None, int]]:
    """Return the file of each kind and the number of its robots, 0 where none is given."""
    if not isinstance(given, tuple):
        return [(None if given is None else Path(str(given)), 0)]
    parts = [word.rpartition(":") for word in given]
    return [(Path(path), int(n)) for path, _, n in parts]


def check_total(given: RobotFile, n_robots: int) -> None:
    """Raise a ConfigError unless the numbers of robots, if they are given, add up."""
    total = sum(n for _, n in files_of(given))
    constraint = f"as many as the kinds of `robot_file` have together, {total}"
    check("n_robots", n_robots, constraint, total in (0, n_robots))


def read_robots(given: RobotFile) -> Robots:
    """Read geometry and mass of the robots of a swarm; see `read_robot`, also for errors."""
    paths, sizes = zip(*files_of(given), strict=True)
    kinds = tuple(map(read_robot, paths))
    return kinds[0] if len(kinds) == 1 else Mixed(kinds, tuple(accumulate(sizes[:-1], initial=0)))


def robot_spec(path: Path | None = None) -> mujoco.MjSpec:
    """Parse a robot's file; meshes that do not lie where it looks for them are taken from `models/meshes`.

    Args:
        path: an MJCF file with the bodies, geoms, joints and sites of `models/robot.xml`, by default that file.

    Raises:
        UserError: the file cannot be read, or something is missing.
    """
    own = models_directory() / "robot.xml"
    path = own if path is None else path
    keep_no_log()
    try:
        check_file(path)
        check_plain(path)
        spec = mujoco.MjSpec.from_file(str(path))
        found = {kind: {element.name for element in getattr(spec, parts)} for kind, parts in _TYPES.items()}
        _check_named(spec, path.parent)
    except (ValueError, RuntimeError, OSError, ExpatError) as error:
        why = "there is none" if isinstance(error, FileNotFoundError) else _one_line(error)
        raise UserError(
            f"the robot's file {path} cannot be read as MJCF ({why}); give a copy of models/robot.xml."
        ) from None
    missing = [
        f"{kind} {name}"
        for kind, names in (_NEEDED | {"site": [*_NEEDED["site"], *_optics(spec)]}).items()
        for name in names
        if name not in found[kind]
    ]
    if missing:
        raise UserError(f"the robot's file {path} lacks {', '.join(missing)}; name its parts as models/robot.xml does.")
    for mesh in spec.meshes:
        beside = own.parent / "meshes" / Path(mesh.file).name
        if not (path.parent / spec.meshdir / mesh.file).exists() and beside.exists():
            mesh.file = str(beside.absolute())
    return spec


def _check_named(spec: mujoco.MjSpec, folder: Path) -> None:
    """Raise an error if a file that a robot's file names has a name that is no text, or is there but is no plain file.

    Args:
        spec: of the robot.
        folder: of its file.
    """
    meshes, textures = (folder / name for name in (spec.meshdir, spec.texturedir))
    named = [meshes / mesh.file for mesh in spec.meshes if mesh.file]
    named += [textures / name for texture in spec.textures for name in (texture.file, *texture.cubefiles) if name]
    named += [folder / skin.file for skin in spec.skins if skin.file]
    for path in named:
        if path.exists():
            check_file(path)


def without_visual(spec: mujoco.MjSpec) -> mujoco.MjSpec:
    """Remove all that is only seen from a robot's specification, and return it."""
    spec.delete(spec.body("visual"))
    for mesh in list(spec.meshes):
        spec.delete(mesh)
    return spec


def read_robot(path: Path | None = None) -> Robot:
    """Read a robot's geometry and mass from its MJCF file.

    The sites of LEDs and photodiodes stand a little off the hull; light starts and ends on the hull's surface, where
    their optical axes cross it.

    Args:
        path: see `robot_spec`.

    Raises:
        UserError: the file cannot be read, lacks something, or describes a robot that cannot be simulated.
    """
    spec = robot_spec(path)
    name = models_directory() / "robot.xml" if path is None else path
    try:
        model = without_visual(spec).compile()
    except (ValueError, RuntimeError) as error:
        raise UserError(f"the robot's file {name} cannot be compiled ({_one_line(error)}).") from None
    unknown = [part for part, numbers in _UNKNOWN.items() if any(np.any(getattr(model, name)) for name in numbers)]
    if unknown:
        raise UserError(
            f"the robot's file {name} has {', '.join(unknown)}; a robot is a hull with sites on three joints that have "
            "damping alone: remove what else there is."
        )
    for requirement, holds in _requirements(model):
        if not holds:
            raise UserError(f"the robot's file {name} must have {requirement}; change it.")
    hull, body, tip = model.geom("hull"), model.body("robot"), model.site("probe_tip")
    half_edges = tuple(hull.size.tolist())
    if hull.pos.any() or body.pos.tolist() != [0.0, 0.0, half_edges[2]]:
        raise UserError(
            f"the hull in {name} must stand on the floor with its centre at the robot's origin (got body at "
            f"{body.pos}, hull at {hull.pos} in it, half height {half_edges[2]}); change their pos."
        )
    n_sides = sum(kind == "led" for kind, _ in _numbered(spec))
    names = [(f"led{side}", f"photodiode{side}a", f"photodiode{side}b") for side in range(n_sides)]
    looks = [[_axis(model, site, name) for site in row] for row in names]
    for row, (_, a, b) in zip(names, looks, strict=True):
        if not np.allclose(a, b, atol=_SAME):
            raise UserError(f"the sites {row[1]} and {row[2]} in {name} must look the same way; change their xyaxes.")
    sides = _sides([led for led, _, _ in looks], [a for _, a, _ in looks], name)
    points = [
        [_on_hull(model, site, axis, half_edges, name) for site, axis in zip(row, axes, strict=True)]
        for row, axes in zip(names, zip(sides.leds, sides.photodiodes, sides.photodiodes, strict=True), strict=True)
    ]
    top_of_tip = body.pos + tip.pos
    return Robot(
        half_edges=half_edges,
        leds=tuple(led for led, _, _ in points),
        photodiodes=tuple((a, b) for _, a, b in points),
        probe_tip=(float(top_of_tip[0]), float(top_of_tip[1])),
        tip_height=float(top_of_tip[2]),
        mass=float(body.mass[0]),
        sides=sides,
    )


def _numbered(spec: mujoco.MjSpec) -> list[tuple[str, int]]:
    """Kind and number of the sites of LEDs and photodiodes."""
    found = [re.fullmatch(r"(led|photodiode)(\d+)[ab]?", site.name) for site in spec.sites]
    return [(match[1], int(match[2])) for match in found if match]


def _optics(spec: mujoco.MjSpec) -> list[str]:
    """Names of the sites that LEDs and photodiodes must have, by the highest number of either."""
    n_sides = max([MIN_LEDS - 1, *(number for _, number in _numbered(spec))]) + 1
    if n_sides > MAX_LEDS:
        raise UserError(
            f"a robot has {MIN_LEDS} to {MAX_LEDS} LEDs, led0 to led{MAX_LEDS - 1}, since three bits of a message are "
            f"the LED's number (got number {n_sides - 1})."
        )
    return [f"{kind}{side}{which}" for side in range(n_sides) for kind, which in _KINDS]


_KINDS = (("led", ""), ("photodiode", "a"), ("photodiode", "b"))


_UNKNOWN = {
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
"""What no engine drives or simulates, and the numbers of MuJoCo's model that show it."""


def _requirements(model: mujoco.MjModel) -> list[tuple[str, bool]]:
    """What all engines require of a robot without its visible parts, and whether it holds."""
    upright = [1.0, 0.0, 0.0, 0.0]
    return [
        ("no bodies but `robot`, outside the body `visual`", model.nbody == 2),
        ("no geoms but `hull`, outside the body `visual`", model.ngeom == 1),
        ("a box as hull", model.geom_type[0] == mujoco.mjtGeom.mjGEOM_BOX),
        (
            "a body and a hull that are not turned",
            model.body_quat[1].tolist() == upright and model.geom_quat[0].tolist() == upright,
        ),
        (
            "the joints x and y, which slide along these axes, and yaw, a hinge about z, in this order and no others",
            tuple(model.jnt_type) == JOINTS
            and [model.joint(j).name for j in range(3)] == ["x", "y", "yaw"]
            and bool(np.allclose(model.jnt_axis, np.eye(3)))
            and not model.jnt_pos.any(),
        ),
        ("joints without ref, so that they are zero where the robot stands in its file", not model.qpos0.any()),
        ("a probe whose tip is above the floor", model.body_pos[1, 2] + model.site("probe_tip").pos[2] > 0),
    ]


def _axis(model: mujoco.MjModel, name: str, path: Path) -> Point:
    """Optical axis of a site, seen from above."""
    matrix = np.zeros(9)
    mujoco.mju_quat2Mat(matrix, model.site(name).quat)
    if abs(matrix[6]) > _SAME:
        raise UserError(f"site {name} in {path} must look along the floor (got x axis {matrix[[0, 3, 6]]}).")
    x, y = (0.0 if abs(part) < 1e-9 else float(part) for part in matrix[[0, 3]])
    return x / math.hypot(x, y), y / math.hypot(x, y)


def _sides(leds: list[Point], photodiodes: list[Point], path: Path) -> Sides:
    """Where LEDs and photodiodes look, exactly along the axes if that is where they look."""
    for kind, axes in (("LEDs", leds), ("pairs of photodiodes", photodiodes)):
        for second, first in combinations(range(len(axes)), 2):
            if np.allclose(axes[first], axes[second], atol=_SAME):
                raise UserError(
                    f"the {kind} {second} and {first} in {path} look the same way, so that light could not be told "
                    "apart by the side on which it falls; change their xyaxes."
                )

    def exact(axes: list[Point]) -> tuple[Point, ...]:
        return SIDES if len(axes) == len(SIDES) and np.allclose(axes, SIDES, atol=_SAME) else tuple(axes)

    return Sides(exact(leds), exact(photodiodes))


def _on_hull(model: mujoco.MjModel, name: str, axis: Point, half_edges: tuple[float, ...], path: Path) -> Point:
    """Where a site's optical axis leaves the hull."""
    pos = model.site(name).pos[:2].tolist()
    behind = [
        (pos[k] * math.copysign(1.0, axis[k]) - half_edges[k]) / abs(axis[k]) if axis[k] else -math.inf for k in (0, 1)
    ]
    face = behind.index(max(behind))  # through which the axis leaves the hull
    point = [float(pos[k] - behind[face] * axis[k]) for k in (0, 1)]
    point[face] = math.copysign(half_edges[face], axis[face])
    if behind[face] < 0 or abs(point[1 - face]) > half_edges[1 - face] + 1e-9:
        raise UserError(
            f"site {name} in {path} must lie outside the hull and look away from it along an outward normal or askew "
            f"(got pos {pos}, x axis {axis}); change its pos or xyaxes."
        )
    return point[0], point[1]


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())
