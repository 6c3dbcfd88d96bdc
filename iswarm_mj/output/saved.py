"""A run read back from its files: what it was, what it came to, and tidy tables of what was recorded."""

import os
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from iswarm_mj.config import N_LEDS, SwarmConfig
from iswarm_mj.engines.registry import IDENTITY
from iswarm_mj.output.reading import REMEDY, no_trajectory, read_about, read_result, read_trajectory
from iswarm_mj.output.said import payload_of, stored
from iswarm_mj.output.tables import TABLES, missing, table_of
from iswarm_mj.output.trajectory import RESULT, TRAJECTORY, Scene
from iswarm_mj.simulation.settings import RunSettings
from iswarm_mj.strategy.genome import Genome
from iswarm_mj.tasks.measures import Measures
from iswarm_mj.utils.constraints import check_kind
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.serialization import restored
from iswarm_mj.utils.units import ROBOT_DIAMETER


@dataclass(frozen=True)
class SavedRun:
    """A run that `load` read. Lengths are in metres, angles in radians, times in seconds.

    The tables are of Arrow: `run.robots["x"].to_numpy()` is an array, `run.robots.filter(pc.field("step") == 100)` a
    part, with `pc` for `pyarrow.compute`, and `run.robots.to_pandas()` a frame where pandas is installed. The metadata
    of a column state its `unit` and its `description`. Rows go by world, step, then robot, ball or receiver and side;
    positions and memories are those after the step, messages, commands and links those of the step. What a robot does
    not know, say or do is null.
    """

    path: Path
    """What was read."""
    version: str
    """Of the package that wrote it."""
    config: SwarmConfig
    genome: Genome | None
    """None where another strategy than the paper's ran, which `strategy` states."""
    strategy: dict[str, Any] | None
    """Class and parameters of a strategy other than the paper's, None for that."""
    task: dict[str, Any]
    """Class and settings of the task."""
    settings: RunSettings
    """`record_worlds` are those that were found."""
    engine: dict[str, Any]
    """Name and main settings of the engine."""
    measures: list[Measures]
    """Of each world, up to where it was if the run was interrupted; none where there is no result.json, and of other
    tasks than cleaning."""
    metrics: list[dict[str, Any]]
    """Of the task in each world, likewise; None for what is not known."""
    result: dict[str, Any]
    """Everything in result.json: `steps`, `fitness`, `wall_s`, `faults` and others; empty if there is none."""
    scenes: dict[int, Scene]
    """Constants of each recorded world, by its number."""
    missing: dict[str, list[str]]
    """Columns that the tables lack, since an earlier version wrote the trajectory."""
    _arrays: dict[int, dict[str, np.ndarray]] = field(repr=False)

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
        """Robots by world and step: place, state, memory, message and command."""
        return self._table("robots")

    @cached_property
    def balls(self) -> pa.Table:
        """Balls by world and step: place, radius, state and holder."""
        return self._table("balls")

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
        try:
            tables = [table_of(name, arrays, world) for world, arrays in self._arrays.items()]
        except (ValueError, TypeError, IndexError, KeyError, pa.ArrowException) as error:
            raise UserError(f"{self.path}: the recorded arrays do not fit each other ({error}); {REMEDY}.") from None
        shared = [c for c in tables[0].column_names if all(c in table.column_names for table in tables)]
        try:
            return pa.concat_tables([table.select(shared) for table in tables])
        except pa.ArrowException:
            raise UserError(
                f"{self.path}: the worlds were recorded by different versions; read them one by one."
            ) from None

    def _check_recorded(self) -> None:
        if not self._arrays:
            raise no_trajectory(self.path.parent if self.path.name == RESULT else self.path, self.result)


def load(path: str | Path) -> SavedRun:
    """Read a run that `iswarm clean` wrote, with all its recorded worlds.

    Args:
        path: its directory, its result.json, or the trajectory.npz of one of its worlds, which is then read alone.

    Raises:
        UserError: there is no run, or a file of it is cut off, foreign, or of a later version.

    Warns:
        UserWarning: an earlier version wrote the trajectory, and columns are missing.
    """
    check_kind("path", path, (str, Path))
    path = Path(path)
    if os.path.isdir(path):
        place = path
        files = [path / TRAJECTORY] if (path / TRAJECTORY).exists() else []
        files += sorted(path.glob(f"world-*/{TRAJECTORY}"), key=_number)
        if not files and not (path / RESULT).exists():
            raise UserError(f"{path} holds neither {RESULT} nor {TRAJECTORY}; {REMEDY}.")
    elif path.name == RESULT:
        return replace(load(path.parent), path=path) if os.path.exists(path) else _nothing(path)
    else:
        place, files = path.parent, [path]
    read = {file: read_trajectory(file) for file in files}
    about = read_about(files[0], read[files[0]]) if files else read_result(place / RESULT)
    source = place / RESULT if not files else files[0]
    try:
        config = restored(SwarmConfig, about["config"])
        strategy = about.get("strategy")
        genome = restored(Genome, about["genome"]) if strategy is None else None
        worlds = _by_number(read)
        settings = _settings(about, tuple(worlds))
        task = dict(about["task"])
        measures = _measures(about, settings.n_worlds)
        metrics = _metrics(about, settings.n_worlds)
        scenes = {number: _scene(arrays, number, config) for number, arrays in worlds.items()}
    except (KeyError, TypeError, AttributeError, ValueError, OverflowError) as error:
        raise UserError(
            f"{source} has settings that this version does not know ({error}); read it with the one that wrote it."
        ) from None
    except UserError as error:
        raise UserError(f"{source}: {error}") from None
    try:
        lacking = {name: sorted({c for arrays in worlds.values() for c in missing(name, arrays)}) for name in TABLES}
    except (ValueError, TypeError, IndexError) as error:
        raise UserError(f"{source}: the recorded arrays do not fit each other ({error}); {REMEDY}.") from None
    lacking = {name: columns for name, columns in lacking.items() if columns}
    if lacking:
        columns = "; ".join(f"{name}: {', '.join(columns)}" for name, columns in lacking.items())
        warnings.warn(f"{source} is of an earlier version, which did not record all columns ({columns})", stacklevel=2)
    return SavedRun(
        path=path,
        version=about.get("version", ""),
        config=config,
        genome=genome,
        strategy=strategy,
        task=task,
        settings=settings,
        engine={name: about[name] for name in IDENTITY if name in about},
        measures=measures,
        metrics=metrics,
        result=about if "wall_s" in about else {},
        scenes=scenes,
        missing=lacking,
        _arrays=worlds,
    )


def _nothing(path: Path) -> Any:
    raise UserError(f"{path} does not exist; {REMEDY}.")


def _number(file: Path) -> int:
    """Number of the world of a trajectory by its folder; 0 where that does not say."""
    name = file.parent.name.removeprefix("world-")
    return int(name) if name.isdigit() else 0


def _by_number(read: Mapping[Path, dict[str, np.ndarray]]) -> dict[int, dict[str, np.ndarray]]:
    """Trajectories by the numbers of their worlds, in ascending order."""
    found: dict[int, dict[str, np.ndarray]] = {}
    for file, arrays in read.items():
        number = int(arrays.get("scene_world", _number(file)))
        if number in found:
            raise UserError(f"two trajectories are of world {number}; read {file} alone.")
        found[number] = arrays
    return dict(sorted(found.items()))


def _settings(about: Mapping[str, Any], recorded: tuple[int, ...]) -> RunSettings:
    """Settings of a run; versions that did not write them wrote the main ones under other names."""
    names = {"n_robots": "n_robots", "steps": "max_steps", "seed": "seed", "n_worlds": "n_worlds", "stop_at": "stop_at"}
    own = about.get("settings") or {name: about[key] for name, key in names.items()}
    return RunSettings(**own, record_worlds=recorded)


def _measures(about: Mapping[str, Any], n_worlds: int) -> list[Measures]:
    usual = Measures._field_defaults
    if not all(name in about for name in Measures._fields if name not in usual):
        return []
    columns = []
    for name in Measures._fields:
        found = about.get(name)
        columns.append([usual[name]] * n_worlds if name not in about else found if n_worlds > 1 else [found])
    return [Measures(*values) for values in zip(*columns, strict=True)]


def _metrics(about: Mapping[str, Any], n_worlds: int) -> list[dict[str, Any]]:
    found = about.get("metrics") or {}
    return [{name: value[k] if n_worlds > 1 else value for name, value in found.items()} for k in range(n_worlds)]


def _scene(arrays: Mapping[str, np.ndarray], number: int, config: SwarmConfig) -> Scene:
    """Constants of a world; for what earlier versions did not write, the same from the configuration."""
    range_ = config.strategy.message_range * ROBOT_DIAMETER
    usual: dict[str, Any] = {
        "is_alive": np.ones(arrays["pose"].shape[1], bool),
        "payload": stored(payload_of({"scene_message_range": range_, **arrays})),
        "world": number,
        "n_leds": N_LEDS,
    }
    found = {name: arrays[f"scene_{name}"] for name in Scene._fields if f"scene_{name}" in arrays}
    values: dict[str, Any] = {name: value if value.ndim else value.item() for name, value in found.items()}
    words = [name for name, usually in Scene._field_defaults.items() if isinstance(usually, tuple) and name in values]
    values |= {name: tuple(tuple(v) if isinstance(v, list) else v for v in values[name].tolist()) for name in words}
    return Scene(**usual | values)
