"""The files of a run, read back: what the run was, and the arrays of its recorded worlds."""

import zipfile
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import jaxtyped

from iswarm_mj.output.schema import ARRAYS
from iswarm_mj.output.trajectory import (
    ABOUT,
    AREA,
    METRIC,
    RESULT,
    SCENE,
    TRAJECTORY,
    Arrays,
    Scene,
)
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.files import check_file, from_json, read_json
from iswarm_mj.utils.memory import check_memory

REMEDY = f"give the --out of a run of `iswarm clean`, or its {RESULT} or {TRAJECTORY}"
LARGEST_TRAJECTORY = 2**36
"""Size up to which a trajectory.npz is read, if its arrays fit into memory [bytes]."""
_KNOWN: dict[str, Any] = {name: f.type for name, f in ARRAYS.items()} | {
    SCENE + n: t for n, t in Scene.__annotations__.items()
}
"""Arrays of each trajectory, and their types."""
_NAMED = {"memory_names": "", "area_names": AREA, "metric_names": METRIC}
"""Fields of `Scene` that name further arrays, and their prefixes."""


def read_result(path: Path) -> dict[str, Any]:
    """Return the content of result.json.

    Raises:
        UserError: there is no such file, or it is no run's.
    """
    return _of_a_run(path, read_json(path, REMEDY))


def _of_a_run(path: Path, content: Any) -> dict[str, Any]:
    if not isinstance(content, dict) or not isinstance(content.get("config"), dict):
        raise UserError(f"{path} is not the {path.name} of a run, for it has no `config`; {REMEDY}.")
    return content


def read_trajectory(path: Path) -> dict[str, np.ndarray]:
    """Return the arrays of trajectory.npz: `Frames`, with the prefix scene_ `Scene`, and `about`.

    Raises:
        UserError: there is no such file, it is no trajectory, or its arrays do not fit each other.
    """
    try:
        check_file(path, LARGEST_TRAJECTORY)
        with zipfile.ZipFile(path) as archive:
            check_memory(sum(part.file_size for part in archive.infolist()))
        with np.load(path) as file:
            arrays = dict(file)
        own = [prefix + n for key, prefix in _NAMED.items() for n in arrays.get(SCENE + key, np.zeros(0)).tolist()]
    except OSError as error:
        raise UserError(f"{path} cannot be read ({error.strerror or error}); {REMEDY}.") from None
    except Exception as error:  # bytes that another program wrote may break each part of the reader
        raise UserError(f"{path} is cut off or no file of arrays ({error}); {REMEDY}.") from None
    for name in (*_KNOWN, *own):
        if name not in arrays:
            raise UserError(f"{path} is not the {TRAJECTORY} of a run, for it has no array `{name}`; {REMEDY}.")
    _check_shapes(path, arrays)
    return arrays


def _check_shapes(path: Path, arrays: Arrays) -> None:
    """Refuse arrays of other kinds of values, sizes that differ along the same axis, and what no camera can show."""
    with jaxtyped("context"):
        for name, kind in _KNOWN.items():
            if hasattr(kind, "dim_str") and not isinstance(arrays[name], kind):
                found = f"{arrays[name].dtype} {arrays[name].shape}"
                raise UserError(
                    f"{path}: `{name}` ({found}) does not fit the other arrays as {kind.__name__}; {REMEDY}."
                )
    for key, prefix in _NAMED.items():
        axes = arrays["pose"].shape[: 2 if key == "memory_names" else 1]
        for name in arrays[SCENE + key].tolist():
            if arrays[prefix + name].shape[: len(axes)] != axes:
                raise UserError(f"{path}: `{prefix + name}` is not there for each step and robot; {REMEDY}.")
    steps = arrays["step"]
    if not len(steps) or not np.array_equal(steps, np.arange(len(steps))):
        raise UserError(f"{path} has no steps that count from 0; {REMEDY}.")
    for name in ("pose", "ball_position", "scene_ball_radius", "scene_robot_size"):
        least = 0.0 if name.startswith(SCENE) else -np.inf
        if not np.all(np.isfinite(arrays[name]) & (arrays[name] > least)):
            raise UserError(f"{path}: `{name}` does not hold finite numbers above {least}; {REMEDY}.")


def read_about(path: Path, arrays: Arrays) -> dict[str, Any]:
    """Return what a run was, as its result.json says or, without one, its trajectory.

    Args:
        path: of the trajectory; result.json lies beside it or, of further worlds, one folder above.
        arrays: of the trajectory.

    Raises:
        UserError: neither says so.
    """
    for place in (path.parent, path.parent.parent)[: 2 if path.parent.name.startswith("world-") else 1]:
        if (place / RESULT).exists():
            return read_result(place / RESULT)
    about = arrays.get(ABOUT, np.zeros(0))
    if about.ndim or about.dtype.kind not in "SU":
        raise UserError(f"{path} does not state its run, and no {RESULT} lies beside it; {REMEDY}.")
    return _of_a_run(path, from_json(about.item(), f"`{ABOUT}` in {path}", REMEDY))
