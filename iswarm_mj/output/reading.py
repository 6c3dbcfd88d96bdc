"""The files of a run, read back: what the run was, and the arrays of its recorded worlds."""

import json
import math
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import jaxtyped

from iswarm_mj.output.schema import ARRAYS, Recorded
from iswarm_mj.output.trajectory import (
    ABOUT,
    AREA,
    METRIC,
    OTHER_RECORDING,
    RECORDING,
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
"""Arrays that are read, and their types."""
_NEEDED = {"step", "pose"} | {SCENE + name for name in Scene._fields if name not in Scene._field_defaults}
"""Those without which a file is no trajectory; those of earlier versions lack others."""
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
    """Return the arrays of trajectory.npz: `Frames`, with the prefix scene_ `Scene`, and `about`; no others are read.

    Quantities that an earlier version did not record are missing.

    Raises:
        UserError: there is no such file, it is no trajectory, or its arrays do not fit each other.
    """
    try:
        check_file(path, LARGEST_TRAJECTORY)
        with zipfile.ZipFile(path) as archive, np.load(path) as file:
            sizes = {part.filename.removesuffix(".npy"): part.file_size for part in archive.infolist()}
            names = [name for name in (*_KNOWN, ABOUT) if name in sizes]
            check_memory(sum(sizes[name] for name in names))
            arrays = Recorded({name: file[name] for name in names})
            own = {prefix + n for key, prefix in _NAMED.items() for n in arrays.get(SCENE + key, np.zeros(0)).tolist()}
            check_memory(sum(sizes[name] for name in own & sizes.keys()))
            arrays.update({name: file[name] for name in sorted(own & sizes.keys())})
    except OSError as error:
        raise UserError(f"{path} cannot be read ({error.strerror or error}); {REMEDY}.") from None
    except Exception as error:  # bytes that another program wrote may break each part of the reader
        raise UserError(f"{path} is cut off or no file of arrays ({error}); {REMEDY}.") from None
    for name in sorted(_NEEDED | own):
        if name not in arrays:
            raise UserError(f"{path} is not the {TRAJECTORY} of a run, for it has no array `{name}`; {REMEDY}.")
    arrays.setdefault("box_pose", np.zeros((*arrays["pose"].shape[:1], 0, 3), np.float32))  # earlier ones had no boxes
    _check_shapes(path, arrays)
    return arrays


def _check_shapes(path: Path, arrays: Arrays) -> None:
    """Refuse arrays of other kinds of values, sizes that differ along the same axis, and balls without a size."""
    with jaxtyped("context"):
        for name, kind in _KNOWN.items():
            if hasattr(kind, "dim_str") and name in arrays and not isinstance(arrays[name], kind):
                found = f"{arrays[name].dtype} {arrays[name].shape}"
                raise UserError(
                    f"{path}: `{name}` ({found}) does not fit the other arrays as {kind.__name__}; {REMEDY}."
                )
    for key, prefix in _NAMED.items():
        axes = arrays["pose"].shape[: 2 if key == "memory_names" else 1]
        for name in arrays.get(SCENE + key, np.zeros(0)).tolist():
            if arrays[prefix + name].shape[: len(axes)] != axes:
                raise UserError(f"{path}: `{prefix + name}` is not there for each step and robot; {REMEDY}.")
    names, sizes = (arrays.get(f"{SCENE}memory_{part}", np.zeros(0)) for part in ("names", "sizes"))
    if not np.array_equal(sizes, [math.prod(arrays[name].shape[2:]) for name in names.tolist()]):
        raise UserError(f"{path}: `{SCENE}memory_sizes` does not fit what robots remember; {REMEDY}.")
    if "scene_payload" in arrays:
        from iswarm_mj.sensors.messages import Payload  # which loads JAX

        try:
            Payload.from_json(json.loads(str(arrays["scene_payload"])))
        except Exception:
            raise UserError(f"{path}: `scene_payload` does not say what messages carry; {REMEDY}.") from None
    for name, end in (("link_sender", arrays["pose"].shape[1]), ("ball_state", 3)):
        if name in arrays and not np.all((arrays[name] >= 0) & (arrays[name] < end)):
            raise UserError(f"{path}: `{name}` must lie between 0 and {end - 1}; {REMEDY}.")
    if len(names) != len(arrays.get(f"{SCENE}memory_units", names)):
        raise UserError(f"{path}: `{SCENE}memory_units` does not fit what robots remember; {REMEDY}.")
    steps = arrays["step"]
    if not len(steps) or not np.array_equal(steps, np.arange(len(steps))):
        raise UserError(f"{path} has no steps that count from 0; {REMEDY}.")
    for name in ("pose", "ball_position", "scene_ball_radius", "scene_robot_size"):
        if name in arrays and not np.isfinite(arrays[name]).all():
            raise UserError(f"{path}: `{name}` does not hold finite numbers; {REMEDY}.")
    if not np.all(arrays["scene_ball_radius"] > 0):
        raise UserError(f"{path}: `scene_ball_radius` must be above 0; {REMEDY}.")


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


def no_trajectory(directory: Path, result: Mapping[str, Any]) -> UserError:
    """Return the error to raise for a run without a trajectory.

    Args:
        directory: of the run.
        result: content of its result.json.
    """
    recordings = [name for name in (RECORDING, OTHER_RECORDING) if (directory / name).exists()]
    if not recordings:
        return UserError(f"{directory} holds no {TRAJECTORY}, since no world was recorded; run it without --no-record.")
    again = f"repeat it by `iswarm {'clean' if RECORDING in recordings else 'run'} --config {directory / RESULT}`"
    if not result.get("interrupted"):
        return UserError(f"{directory} holds no {TRAJECTORY}, although its run has ended; put it back, or {again}.")
    return UserError(
        f"{directory} holds no {TRAJECTORY}, which is written at the end; the run is unfinished or was killed: wait "
        f"for its end, or {again}. What was recorded until then is in {directory / recordings[0]}."
    )
