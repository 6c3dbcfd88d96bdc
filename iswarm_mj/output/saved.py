"""A run read back from its files: settings, results, and tidy tables of the recording."""

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, fields, is_dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import pyarrow as pa

from iswarm_mj.config import SwarmConfig
from iswarm_mj.engines.registry import IDENTITY
from iswarm_mj.engines.robot_file import as_robot_file
from iswarm_mj.output.reading import REMEDY, no_trajectory, read_about, read_result, read_trajectory
from iswarm_mj.output.tables import TABLES, table_of
from iswarm_mj.output.trajectory import RESULT, SCENE, TRAJECTORY, Arrays, Scene
from iswarm_mj.simulation.settings import RunSettings
from iswarm_mj.strategy.genome import Genome
from iswarm_mj.tasks.measures import Measures
from iswarm_mj.utils.constraints import check_kind
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.robot import RobotFile

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
    version: str
    """Version of the package that wrote it."""
    config: SwarmConfig
    genome: Genome | None
    """Parameters of the paper's strategy; None for another one, see `strategy`."""
    strategy: dict[str, Any] | None
    """Class and parameters of a strategy other than the paper's; None for the paper's."""
    task: dict[str, Any]
    """Class and settings of the task."""
    settings: RunSettings
    """Settings of the run; `record_worlds` are the recorded worlds found."""
    engine: dict[str, Any]
    """Name and main settings of the engine."""
    measures: list[Measures]
    """Measures of each world, of an interrupted run up to the interruption; empty without result.json, and for tasks
    other than cleaning."""
    metrics: list[dict[str, Any]]
    """Metrics of the task in each world; None for unknown ones."""
    result: dict[str, Any]
    """Everything in result.json: `steps`, `fitness`, `wall_s`, `faults` and others; empty if there is none."""
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
    def units(self) -> dict[str, dict[str, str]]:
        """Unit of each column of each table, empty for numbers without one."""
        tables = {name: getattr(self, name) for name in TABLES}
        return {name: {f.name: f.metadata[b"unit"].decode() for f in table.schema} for name, table in tables.items()}

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
            raise no_trajectory(self.path.parent if self.path.name == RESULT else self.path)


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
        settings = RunSettings(**about["settings"], record_worlds=tuple(worlds))
        n_worlds = settings.n_worlds
        measures = {name: _by_world(about[name], n_worlds) for name in Measures._fields if name in about}
        metrics = {name: _by_world(values, n_worlds) for name, values in (about.get("metrics") or {}).items()}
        known = range(min(n_worlds, *map(len, [*measures.values(), *metrics.values(), range(n_worlds)])))
        return SavedRun(
            path=path,
            version=about["version"],
            config=restored(SwarmConfig, about["config"]),
            genome=restored(Genome, about["genome"]) if "genome" in about else None,
            strategy=about.get("strategy"),
            task=about["task"],
            settings=settings,
            engine={name: about[name] for name in IDENTITY if name in about},
            measures=[
                Measures(**{name: of[k] for name, of in measures.items()}) for k in known if "picked" in measures
            ],
            metrics=[{name: values[k] for name, values in metrics.items()} for k in known],
            result=about if "wall_s" in about else {},
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


def restored(cls: type[Any], values: Mapping[str, Any]) -> Any:
    """Return the dataclass that `asdict` turned into this dictionary.

    Args:
        cls: the dataclass; fields that are dataclasses have them as default factories.
        values: by the names of its fields; those left out have their defaults.

    Raises:
        TypeError: a name that the dataclass does not have.
    """
    inner: dict[str, Any] = {f.name: f.default_factory for f in fields(cls) if is_dataclass(f.default_factory)}
    return cls(**{name: restored(inner[name], value) if name in inner else value for name, value in values.items()})


def _by_world(values: Any, n_worlds: int) -> list[Any]:
    """A measure of each world; one world states it by itself, and what an interrupted run does not know is None."""
    return values if isinstance(values, list) else [values] * n_worlds


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
