"""A run read back from its files, which are checked: settings, results, arrays, and tidy tables of the recording."""

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

from iswarm_mj.config.swarm import SwarmConfig
from iswarm_mj.engines.robot_file import as_robot_file
from iswarm_mj.geometry.robot import RobotFile
from iswarm_mj.output.schema import ARRAYS
from iswarm_mj.output.tables import table_of
from iswarm_mj.output.trajectory import ABOUT, AREA, METRIC, RESULT, SCENE, TRAJECTORY, Arrays, Scene
from iswarm_mj.simulation.settings import RunSettings
from iswarm_mj.strategy.genome import Genome
from iswarm_mj.utils.constraints import check_kind
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.files import check_file, from_json, read_json, restored
from iswarm_mj.utils.ram import check_memory

REMEDY = f"give the --out of a run of `iswarm clean`, or its {RESULT} or {TRAJECTORY}"
LARGEST_TRAJECTORY = 2**36
"""Size up to which a trajectory.npz is read, if its arrays fit into memory [bytes]."""
_KNOWN: dict[str, Any] = {name: f.type for name, f in ARRAYS.items()} | {
    SCENE + n: t for n, t in Scene.__annotations__.items()
}
"""Arrays of each trajectory, and their types."""
_NAMED = {"memory_names": "", "area_names": AREA, "metric_names": METRIC}
"""Fields of `Scene` that name further arrays, and their prefixes."""
_MISFITS = (ValueError, TypeError, LookupError, ArithmeticError, AssertionError, RecursionError, pa.ArrowException)
"""What arrays that do not fit each other raise where they become tables or pictures."""


@dataclass(frozen=True)
class SavedRun:
    """A run that `load` read. Lengths are in metres, angles in radians, times in seconds.

    The tables are of Arrow: `run.robots["x"].to_numpy()` is an array, `run.robots.filter(pc.field("step") == 100)` a
    part, with `pc` for `pyarrow.compute`, and `run.robots.to_pandas()` a frame where pandas is installed. The metadata
    of a column state its `unit` and its `description`. Rows go by world, step, then robot, ball, box or receiver and
    side; positions and memories are those after the step, messages, commands and links those of the step. What a robot
    does not know, say or do is null.
    """

    path: Path
    """Directory of the run."""
    config: SwarmConfig
    genome: Genome | None
    """Parameters of the paper's strategy; None for another one, see `result`."""
    settings: RunSettings
    """Settings of the run; `record_worlds` are the recorded worlds found."""
    result: dict[str, Any]
    """Everything in result.json: measures such as `delivered`, of several worlds as lists, `metrics` of the task,
    `steps`, `faults`, `version`, `engine`, `strategy` and others; without the file what the trajectory states of its
    run."""
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
        """Links by world, step, receiver and side: sender and its LED, bearing, distances, whether it was heard."""
        return self._table("links")

    @cached_property
    def steps(self) -> pa.Table:
        """Control steps by world: time, counts so far, mean speed."""
        return self._table("steps")

    def _table(self, name: str) -> pa.Table:
        self._check_recorded()
        with self.explained():
            tables = [table_of(name, self._arrays[n], scene) for n, scene in self.scenes.items()]
            return pa.concat_tables(tables, promote_options="default")  # null where a world lacks a column

    @contextmanager
    def explained(self) -> Iterator[None]:
        """Raise a UserError for what recorded arrays cause that do not fit each other."""
        try:
            yield
        except _MISFITS as error:
            cause = str(error).partition("\n")[0]
            raise UserError(f"{self.path}: the recorded arrays do not fit each other ({cause}); {REMEDY}.") from error

    def _check_recorded(self) -> None:
        if not self._arrays:
            raise UserError(
                f"{self.path} is of a run without {TRAJECTORY}, which is written at the end, unless with --no-record; "
                "wait for the end, or repeat the run."
            )


def load(path: str | Path) -> SavedRun:
    """Read a run that `iswarm clean` wrote, with all its recorded worlds.

    Args:
        path: its directory, its result.json, or the trajectory.npz of one of its worlds, which is then read alone.

    Raises:
        UserError: there is no run, or a file of it is cut off, foreign, or of another version.
    """
    check_kind("path", path, (str, Path))
    path = Path(path)
    place = path if os.path.isdir(path) else path.parent
    files = [path]
    if place == path or path.name == RESULT:
        files = [file for file in (place / TRAJECTORY, *place.glob(f"world-*/{TRAJECTORY}")) if os.path.lexists(file)]
        if not os.path.exists(path):
            raise UserError(f"{path} does not exist; {REMEDY}.")
        if not files and not (place / RESULT).exists():
            raise UserError(f"{path} holds neither {RESULT} nor {TRAJECTORY}; {REMEDY}.")
    read = {file: read_trajectory(file) for file in files}
    about = read_about(files[0], read[files[0]]) if files else read_result(place / RESULT)
    source = files[0] if files else place / RESULT
    try:
        worlds = _by_number(read)
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
    except (KeyError, TypeError, AttributeError, ValueError, IndexError, OverflowError) as error:
        raise UserError(
            f"{source} has settings that this version does not know ({error}); read it with the one that wrote it."
        ) from None
    except UserError as error:
        raise UserError(f"{source}: {error}; {REMEDY}.") from None


def _by_number(read: Mapping[Path, Arrays]) -> dict[int, Arrays]:
    """Trajectories by the numbers of their worlds, in ascending order."""
    found: dict[int, Arrays] = {}
    for file, arrays in read.items():
        number = int(arrays["scene_world"])
        if number in found:
            raise UserError(f"two trajectories are of world {number}; read {file} alone")
        found[number] = arrays
    return dict(sorted(found.items()))


def scene_of(arrays: Arrays) -> Scene:
    """Return the constants of a world."""
    values: dict[str, Any] = {name: arrays[SCENE + name] for name in Scene._fields}
    values = {name: value if value.ndim else value.item() for name, value in values.items()}
    words = [name for name in values if isinstance(Scene._field_defaults.get(name), tuple)]
    values |= {name: tuple(tuple(v) if isinstance(v, list) else v for v in values[name].tolist()) for name in words}
    return Scene(**values)


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
