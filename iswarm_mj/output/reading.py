"""The files of a run, read back: what the run was, and the arrays of its recorded worlds."""

import json
import zipfile
from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from iswarm_mj.output.trajectory import ABOUT, OTHER_RECORDING, RECORDING, RESULT, TRAJECTORY, Frames, Scene
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.files import check_file
from iswarm_mj.utils.memory import check_memory

REMEDY = f"give the --out of a run of `iswarm clean`, or its {RESULT} or {TRAJECTORY}"
LARGEST_RESULT = 2**28
"""Size up to which a result.json is read [bytes]."""
LARGEST_TRAJECTORY = 2**36
"""Likewise a trajectory.npz, if its arrays fit into memory."""
NEEDED = ("step", "pose")
"""Arrays without which a file is no trajectory."""


def read_result(path: Path) -> dict[str, Any]:
    """Return the content of result.json.

    Raises:
        UserError: there is no such file, or it is no run's.
    """
    try:
        check_file(path, LARGEST_RESULT)
        content = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise UserError(f"{path} cannot be read ({error.strerror or error}); {REMEDY}.") from None
    except (ValueError, RecursionError) as error:
        raise UserError(f"{path} is cut off or no JSON ({error}); {REMEDY}.") from None
    if not isinstance(content, dict) or not isinstance(content.get("config"), dict):
        raise UserError(f"{path} is not the {RESULT} of a run, for it has no `config`; {REMEDY}.")
    return content


def read_trajectory(path: Path) -> dict[str, np.ndarray]:
    """Return the arrays of trajectory.npz: `Frames`, with the prefix scene_ `Scene`, and `about`.

    Files of earlier versions lack some.

    Raises:
        UserError: there is no such file, it is no trajectory, or its arrays do not fit each other.
    """
    try:
        check_file(path, LARGEST_TRAJECTORY)
        _check_room(path)
        with np.load(path) as file:
            arrays = dict(file)
    except OSError as error:
        raise UserError(f"{path} cannot be read ({error.strerror or error}); {REMEDY}.") from None
    except Exception as error:  # bytes that another program wrote may break each part of the reader
        raise UserError(f"{path} is cut off or no file of arrays ({error}); {REMEDY}.") from None
    lacking = [name for name in NEEDED if name not in arrays]
    if lacking:
        raise UserError(f"{path} is not the {TRAJECTORY} of a run, for it has no array `{lacking[0]}`; {REMEDY}.")
    try:
        _check_shapes(path, arrays)
    except (TypeError, ValueError, IndexError) as error:
        raise UserError(f"{path}: its arrays do not fit each other ({error}); {REMEDY}.") from None
    return arrays


def read_about(path: Path, arrays: Mapping[str, np.ndarray]) -> dict[str, Any]:
    """Return what a run was, as its result.json says or, without one, its trajectory.

    Args:
        path: of the trajectory; result.json lies beside it or, of further worlds, one folder above.
        arrays: of the trajectory.

    Raises:
        UserError: neither says so.
    """
    places = [path.parent, *([path.parent.parent] if path.parent.name.startswith("world-") else [])]
    for place in places:
        if (place / RESULT).exists():
            return read_result(place / RESULT)
    if ABOUT not in arrays:
        raise UserError(
            f"{path} is of an older version, and there is no {RESULT} beside it that states its configuration; "
            "put it back where it was written."
        )
    return json.loads(arrays[ABOUT].item())


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
        f"{directory} holds no {TRAJECTORY}, which a run writes at its end, and this one goes on, or was killed; wait "
        f"for its end, or {again}: what was recorded until then is in {directory / recordings[0]}."
    )


def _check_room(path: Path) -> None:
    """Raise a MemoryError if the arrays need more memory than there is."""
    with zipfile.ZipFile(path) as file:
        needed = sum(part.file_size for part in file.infolist())
    check_memory(needed)


def _check_shapes(path: Path, arrays: Mapping[str, np.ndarray]) -> None:
    """Refuse arrays of other kinds of values, and those whose sizes along the same axis differ."""
    sizes: dict[str, tuple[int, str]] = {}
    kinds = {f.name: f.type for f in fields(Frames)}
    kinds |= {f"scene_{name}": kind for name, kind in Scene.__annotations__.items()}
    kinds = {
        name: kind
        for name, kind in kinds.items()
        if not name.startswith(("scene_memory_", "scene_area_", "scene_metric_"))
    }
    for name, kind in kinds.items():
        axes = getattr(kind, "dim_str", "").split()
        if name not in arrays:
            continue
        found, dtype = arrays[name].shape, arrays[name].dtype
        if dtype.name not in getattr(kind, "dtypes", [dtype.name]):
            raise UserError(f"{path}: `{name}` holds values of the kind {dtype}; {REMEDY}.")
        wanted = [sizes.setdefault(axis, (size, name)) for axis, size in zip(axes, found, strict=False)]
        for axis, (size, first), mine in zip(axes, wanted, found, strict=False):
            if mine != (int(axis) if axis.isdigit() else size):
                raise UserError(f"{path}: the shape {found} of `{name}` does not fit that of `{first}`; {REMEDY}.")
        if len(axes) != len(found):
            raise UserError(f"{path}: `{name}` has {len(found)} axes instead of {len(axes)}; {REMEDY}.")
    for name in np.atleast_1d(arrays.get("scene_memory_names", [])).tolist():
        if name not in arrays or arrays[name].shape[:2] != arrays["pose"].shape[:2]:
            raise UserError(f"{path}: `{name}` is not there for each step and robot; {REMEDY}.")
