"""Loads a run from its files, which are checked: settings, results, arrays, and tidy tables."""

import json
import os
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from jaxtyping import jaxtyped

from iswarm_mj._version import __version__
from iswarm_mj.config.swarm import SwarmConfig
from iswarm_mj.engines.robot_file import as_robot_file
from iswarm_mj.geometry.robot import RobotFile
from iswarm_mj.output.schema import ARRAYS
from iswarm_mj.output.tables import make_table
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
from iswarm_mj.simulation.settings import RunSettings
from iswarm_mj.strategy.genome import Genome
from iswarm_mj.utils.constraints import check_kind
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.files import check_file, from_json, read_json, restored
from iswarm_mj.utils.ram import check_memory

REMEDY = f"give the --out of a run of `iswarm clean`, or its {RESULT} or {TRAJECTORY}"
MAX_TRAJECTORY_BYTES = 2**36
"""Maximum size of a trajectory.npz; its arrays must also fit into memory [bytes]."""
FURTHER_WORLD = "world-"
"""Prefix of the directories of further worlds of a run."""
_ARRAY_TYPES: dict[str, Any] = {name: quantity.type for name, quantity in ARRAYS.items()} | {
    SCENE + name: annotation for name, annotation in Scene.__annotations__.items()
}
"""Types of the arrays that each trajectory has, by name."""
_PREFIX_OF_NAMES = {"memory_names": "", "area_names": AREA, "metric_names": METRIC}
"""Fields of `Scene` that name further arrays, with the prefix of these."""
_MISFIT_ERRORS = (
    ValueError,
    TypeError,
    LookupError,
    ArithmeticError,
    AssertionError,
    RecursionError,
    pa.ArrowException,
)
"""Exceptions of tables and pictures whose arrays do not fit each other."""
_UNKNOWN_SETTINGS_ERRORS = (
    KeyError,
    TypeError,
    AttributeError,
    ValueError,
    IndexError,
    OverflowError,
)
"""Exceptions of settings that another version wrote."""


@dataclass(frozen=True)
class SavedRun:
    """A run that `load` read. Lengths are in metres, angles in radians, times in seconds.

    The tables are of Arrow: `run.robots["x"].to_numpy()` is an array,
    `run.robots.filter(pc.field("step") == 100)` a part, with `pc` for `pyarrow.compute`, and
    `run.robots.to_pandas()` a frame where pandas is installed. The metadata of a column state its
    `unit` and its `description`. Rows go by world, step, then robot, ball, box or receiver and
    side; positions and memories are those after the step, messages, commands and links those of
    the step. What a robot does not know, send or do is null.
    """

    path: Path
    """Directory of the run."""
    config: SwarmConfig
    genome: Genome | None
    """Parameters of the paper's strategy; None for another one, see `result`."""
    settings: RunSettings
    """Settings of the run; `record_worlds` are the recorded worlds that were found."""
    result: dict[str, Any]
    """Content of result.json or, without the file, what the trajectory states of its run.

    It holds measures such as `delivered`, of several worlds as lists, `metrics` of the task,
    `steps`, `faults`, `version`, `engine`, `strategy` and others.
    """
    scenes: dict[int, Scene]
    """Constants of each recorded world, by its number."""
    robot_file: RobotFile
    """MJCF file of the robots, or of each kind (`RobotFile`); None for `models/robot.xml`."""
    _arrays: dict[int, Arrays] = field(repr=False)

    @property
    def arrays(self) -> Arrays:
        """Arrays of the trajectory of the first recorded world, see `output.schema`.

        Raises:
            UserError: no world was recorded, or the run did not end.
        """
        self._check_recorded()
        return next(iter(self._arrays.values()))

    @property
    def scene(self) -> Scene:
        """Constants of the first recorded world.

        Raises:
            UserError: no world was recorded, or the run did not end.
        """
        self._check_recorded()
        return next(iter(self.scenes.values()))

    @cached_property
    def robots(self) -> pa.Table:
        """Robots by world and step: position, state, memory, message and command."""
        return self._table("robots")

    @cached_property
    def balls(self) -> pa.Table:
        """Balls by world and step: position, radius, state and holder."""
        return self._table("balls")

    @cached_property
    def boxes(self) -> pa.Table:
        """Boxes that robots push, by world and step: position."""
        return self._table("boxes")

    @cached_property
    def links(self) -> pa.Table:
        """Links by world, step, receiver and side.

        They have the sender and its LED, bearing, distances, and whether the message was heard.
        """
        return self._table("links")

    @cached_property
    def steps(self) -> pa.Table:
        """Control steps by world: time, counts so far, mean speed."""
        return self._table("steps")

    def _table(self, name: str) -> pa.Table:
        """Return a table of all recorded worlds."""
        self._check_recorded()
        with self.explained():
            tables = [
                make_table(name, self._arrays[world], scene) for world, scene in self.scenes.items()
            ]
            # Values are null where a world lacks a column.
            return pa.concat_tables(tables, promote_options="default")

    @contextmanager
    def explained(self) -> Iterator[None]:
        """Raise a UserError for exceptions of the block that misfitting arrays cause."""
        try:
            yield
        except _MISFIT_ERRORS as error:
            cause = str(error).partition("\n")[0]
            raise UserError(
                f"{self.path}: the recorded arrays do not fit each other ({cause}); {REMEDY}."
            ) from error

    def _check_recorded(self) -> None:
        """Raise a UserError if no world was recorded."""
        if not self._arrays:
            raise UserError(
                f"{self.path} is of a run without {TRAJECTORY}, which is written at the end, "
                "unless with --no-record; wait for the end, or repeat the run."
            )


def load(path: str | Path) -> SavedRun:
    """Load a run that `iswarm clean` wrote, with all its recorded worlds.

    Args:
        path: its directory, its result.json, or the trajectory.npz of one of its worlds, which is
            then loaded alone.

    Raises:
        UserError: there is no run, or one of its files is incomplete, foreign, or of another
            version.
    """
    check_kind("path", path, (str, Path))
    path = Path(path)
    files = _trajectories_of(path)
    trajectories = {file: read_trajectory(file) for file in files}
    if files:
        source = files[0]
        about = read_about(source, trajectories[source])
    else:
        source = _directory_of(path) / RESULT
        about = read_result(source)

    try:
        worlds = _by_world(trajectories)
        return SavedRun(
            path=path,
            config=restored(SwarmConfig, about["config"]),
            genome=restored(Genome, about["genome"]) if "genome" in about else None,
            settings=RunSettings(**about["settings"], record_worlds=tuple(worlds)),
            result=about,
            robot_file=as_robot_file(about["robot"]["file"]),
            scenes={number: scene_of(arrays) for number, arrays in worlds.items()},
            _arrays=worlds,
        )
    except _UNKNOWN_SETTINGS_ERRORS as error:
        reason = f"{source} has settings that this version does not know ({error})"
        raise UserError(f"{reason}; read it with the one that wrote it.") from None
    except UserError as error:
        raise UserError(f"{source}: {error}; {REMEDY}.") from None


def _directory_of(path: Path) -> Path:
    """Return the directory of a run from the path of the directory or of one of its files."""
    return path if os.path.isdir(path) else path.parent


def _trajectories_of(path: Path) -> list[Path]:
    """Return the files of the recorded worlds; none if no world was recorded.

    Args:
        path: the directory of a run, its result.json, or the trajectory.npz of one of its worlds.

    Raises:
        UserError: there is no run.
    """
    directory = _directory_of(path)
    if path != directory and path.name != RESULT:
        return [path]
    candidates = [directory / TRAJECTORY, *directory.glob(f"{FURTHER_WORLD}*/{TRAJECTORY}")]
    files = [file for file in candidates if os.path.lexists(file)]
    if not os.path.exists(path):
        raise UserError(f"{path} does not exist; {REMEDY}.")
    if not files and not (directory / RESULT).exists():
        raise UserError(f"{path} holds neither {RESULT} nor {TRAJECTORY}; {REMEDY}.")
    return files


def _by_world(trajectories: Mapping[Path, Arrays]) -> dict[int, Arrays]:
    """Return trajectories by the numbers of their worlds, in ascending order."""
    by_world: dict[int, Arrays] = {}
    for file, arrays in trajectories.items():
        number = int(arrays["scene_world"])
        if number in by_world:
            raise UserError(f"two trajectories are of world {number}; read {file} alone")
        by_world[number] = arrays
    return dict(sorted(by_world.items()))


def scene_of(arrays: Arrays) -> Scene:
    """Return the constants of a world."""
    values: dict[str, Any] = {}
    for name in Scene._fields:
        array = arrays[SCENE + name]
        is_tuple = isinstance(Scene._field_defaults.get(name), tuple)
        if is_tuple:
            values[name] = tuple(_as_tuple(item.tolist()) for item in array)
        elif array.ndim == 0:
            values[name] = array.item()
        else:
            values[name] = array
    return Scene(**values)


def _as_tuple(item: Any) -> Any:
    """Return a list as a tuple, such as a colour, and anything else as it is."""
    return tuple(item) if isinstance(item, list) else item


def read_result(path: Path) -> dict[str, Any]:
    """Return the content of result.json.

    Raises:
        UserError: there is no such file, or it is not that of a run.
    """
    return _checked_about(path, read_json(path, REMEDY))


def _checked_about(path: Path, content: Any) -> dict[str, Any]:
    """Return the description of a run, after a check that it has a configuration.

    Args:
        path: the file that holds it.
        content: the description.
    """
    if not isinstance(content, dict) or not isinstance(content.get("config"), dict):
        raise UserError(
            f"{path} is not the {path.name} of a run, for it has no `config`; {REMEDY}."
        )
    return content


def read_trajectory(path: Path) -> dict[str, np.ndarray]:
    """Return the arrays of trajectory.npz.

    They are those of `Frames`, with the prefix scene_ those of `Scene`, and `about`.

    Raises:
        UserError: there is no such file, it is no trajectory, or its arrays do not fit each other.
    """
    try:
        check_file(path, MAX_TRAJECTORY_BYTES)
        with zipfile.ZipFile(path) as archive:
            check_memory(sum(part.file_size for part in archive.infolist()))
        with np.load(path) as file:
            arrays = dict(file)
        further_names = []
        for field_name, prefix in _PREFIX_OF_NAMES.items():
            names = arrays.get(SCENE + field_name, np.zeros(0))
            further_names += [prefix + name for name in names.tolist()]
    except OSError as error:
        raise UserError(f"{path} cannot be read ({error.strerror or error}); {REMEDY}.") from None
    except Exception as error:  # bytes of another program may break any part of the reader
        raise UserError(f"{path} is cut off or no file of arrays ({error}); {REMEDY}.") from None
    for name in (*_ARRAY_TYPES, *further_names):
        if name not in arrays:
            raise _missing_array(path, arrays, name)
    _check_arrays(path, arrays)
    return arrays


def _missing_array(path: Path, arrays: Arrays, name: str) -> UserError:
    """Return the error for a trajectory that lacks an array, which another version may not have."""
    fact = f"has no array `{name}`"
    written_by = _version_of(arrays)
    if written_by in (None, __version__):
        return UserError(f"{path} is not the {TRAJECTORY} of a run, for it {fact}; {REMEDY}.")
    return UserError(
        f"{path} {fact}, for version {written_by} wrote it and this is {__version__}; read it with "
        "that one, or repeat the run."
    )


def _version_of(arrays: Arrays) -> str | None:
    """Return the version that wrote a trajectory; None if it does not state one."""
    about = arrays.get(ABOUT, np.zeros(0))
    if about.ndim or about.dtype.kind not in "SU":
        return None
    try:
        content = json.loads(about.item())
    except ValueError:
        return None
    version = content.get("version") if isinstance(content, dict) else None
    return version if isinstance(version, str) else None


def _check_arrays(path: Path, arrays: Arrays) -> None:
    """Raise a UserError for arrays that do not fit each other, or that no camera can show."""
    # Types, and one size along each axis.
    with jaxtyped("context"):
        for name, annotation in _ARRAY_TYPES.items():
            array = arrays[name]
            if hasattr(annotation, "dim_str") and not isinstance(array, annotation):
                raise UserError(
                    f"{path}: `{name}` ({array.dtype} {array.shape}) does not fit the other arrays "
                    f"as {annotation.__name__}; {REMEDY}."
                )
    for field_name, prefix in _PREFIX_OF_NAMES.items():
        n_axes = 2 if field_name == "memory_names" else 1
        axes = arrays["pose"].shape[:n_axes]
        for name in arrays[SCENE + field_name].tolist():
            if arrays[prefix + name].shape[:n_axes] != axes:
                raise UserError(
                    f"{path}: `{prefix + name}` is not there for each step and robot; {REMEDY}."
                )

    # Steps from 0, and finite places and sizes.
    steps = arrays["step"]
    if not len(steps) or not np.array_equal(steps, np.arange(len(steps))):
        raise UserError(f"{path} has no steps that count from 0; {REMEDY}.")
    for name in ("pose", "ball_position", "scene_ball_radius", "scene_robot_size"):
        is_size = name.startswith(SCENE)
        least = 0.0 if is_size else -np.inf
        if not np.all(np.isfinite(arrays[name]) & (arrays[name] > least)):
            raise UserError(
                f"{path}: `{name}` does not hold finite numbers above {least}; {REMEDY}."
            )


def read_about(path: Path, arrays: Arrays) -> dict[str, Any]:
    """Return the description of a run from its result.json or, without one, from its trajectory.

    Args:
        path: the trajectory; result.json lies in its directory or, for further worlds, one above.
        arrays: arrays of the trajectory.

    Raises:
        UserError: neither describes the run.
    """
    directories = [path.parent]
    if path.parent.name.startswith(FURTHER_WORLD):
        directories.append(path.parent.parent)
    for directory in directories:
        if (directory / RESULT).exists():
            return read_result(directory / RESULT)
    about = arrays.get(ABOUT, np.zeros(0))
    if about.ndim or about.dtype.kind not in "SU":
        raise UserError(f"{path} does not state its run, and no {RESULT} lies beside it; {REMEDY}.")
    return _checked_about(path, from_json(about.item(), f"`{ABOUT}` in {path}", REMEDY))
