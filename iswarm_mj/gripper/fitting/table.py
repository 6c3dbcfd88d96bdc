"""Tables of measurements: reading, units, and sentences on bad ones."""

import csv
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from iswarm_mj.gripper.laws import materials
from iswarm_mj.gripper.laws.detachment import PROBE_RADIUS, RELEASE_GAP
from iswarm_mj.gripper.laws.probe_table import GAP_EXPONENTS, PROBE_EXPONENTS
from iswarm_mj.utils.constraints import Within
from iswarm_mj.utils.errors import ConfigError, UserError, closest, shown
from iswarm_mj.utils.files import read_text

KINDS = ("grasp", "release", "no_contact", "pull_off_tool", "pull_off_plate", "melting")
"""Kinds of measurements.

Least voltage that lifts a touched ball, that releases a held one, that lifts a ball across a gap;
force that separates ball and tool, or ball and plate; voltage that melts a ball in contact.
"""
FORCES = ("pull_off_tool", "pull_off_plate")
"""Kinds that are forces."""
ELECTRICAL = ("grasp", "release", "no_contact")
"""Kinds in which an electrical force moves the ball."""
ACROSS_GAPS = ("release", "no_contact")
"""Kinds that depend on a gap of the row."""
MIN_GAP_RATIO = 2.0 ** GAP_EXPONENTS[0].item()
"""Smallest gap over the radius of the ball for which the laws hold."""
MAX_GAP_RATIO = 2.0 ** GAP_EXPONENTS[-1].item()
"""Largest gap over the radius of the ball for which the laws hold."""
PROBE_RATIOS = Within(2.0 ** PROBE_EXPONENTS[0].item(), 2.0 ** PROBE_EXPONENTS[-1].item())
"""Radii of the tool over that of the ball for which the laws hold."""
MAX_ROWS = 100_000
"""Largest number of rows that is read."""
_KIND_WORDS = {
    "lift": "grasp",
    "lift_without_contact": "no_contact",
    "without_contact": "no_contact",
    "pull_off": "pull_off_tool",
    "pull_off_force": "pull_off_tool",
    "pull_off_from_tool": "pull_off_tool",
    "pull_off_from_plate": "pull_off_plate",
    "melt": "melting",
}
"""Further words for kinds."""

_LENGTHS = {"m": 1.0, "mm": 1e-3, "um": 1e-6, "µm": 1e-6, "μm": 1e-6, "nm": 1e-9}
_PERCENT = {"%": 1.0, "%RH": 1.0, "% RH": 1.0, "fraction": 100.0}
_VOLTAGES = {"mV": 1e-3, "V": 1.0, "kV": 1e3}
_FORCES = {"N": 1.0, "mN": 1e-3, "uN": 1e-6, "µN": 1e-6, "μN": 1e-6, "nN": 1e-9}
_DENSITIES = {"kg/m^3": 1.0, "kg/m3": 1.0, "g/cm^3": 1e3, "g/cm3": 1e3}


class _Column(NamedTuple):
    """A column of numbers that a table may have."""

    units: Mapping[str, float]
    """Units, and what they are in SI; none for a pure number."""
    allowed: Within
    """Values in SI."""
    example: str = ""
    """A usual unit, for messages."""


_VOLTAGE = _Column(_VOLTAGES, Within(0, 1000, "V"), "V")
_FORCE = _Column(_FORCES, Within(0, 1e-3, "N"), "nN")
_LENGTH = Within(0, 1e-3, "m")
COLUMNS: dict[str, _Column] = {
    "radius": _Column(_LENGTHS, Within(2e-6, 100e-6, "m"), "um"),
    "humidity": _Column(_PERCENT, Within(0, 100, "%"), "%"),
    "gap": _Column(_LENGTHS, Within(0.5e-6, 50e-6, "m"), "um"),
    "voltage": _VOLTAGE,
    "voltage_low": _VOLTAGE,
    "voltage_high": _VOLTAGE,
    "force": _FORCE,
    "force_low": _FORCE,
    "force_high": _FORCE,
    "uncertainty": _VOLTAGE,
    "force_uncertainty": _FORCE,
    "repeats": _Column({}, Within(1, 1_000_000)),
    "probe_radius": _Column(_LENGTHS, Within(2e-6, 80e-6, "m"), "um"),
    "tip_curvature": _Column(_LENGTHS, Within(5e-6, 1e-3, "m"), "um"),
    "ball_density": _Column(_DENSITIES, Within(100, 25e3, "kg/m^3"), "kg/m^3"),
}
"""Columns of numbers by name."""
MATERIALS = ("ball_material", "tool_material", "plate_material")
_WORDS = ("kind", *MATERIALS)
"""Columns of words."""
_NAMES = {
    "ball_radius": "radius",
    "r": "radius",
    "rh": "humidity",
    "relative_humidity": "humidity",
    "experiment": "kind",
    "n": "repeats",
    "tip_radius": "probe_radius",
    "tool_radius": "probe_radius",
    "density": "ball_density",
    "material": "ball_material",
}
"""Further names of columns."""
_HEADER = re.compile(r"(.*?)\s*(?:[\[(](.*)[\])])?\s*")
_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_BOUND = re.compile(rf"([<>≤≥]=?)\s*({_NUMBER})")
_RANGE = re.compile(rf"({_NUMBER})\s*(?:-|–|\.\.|to)\s*({_NUMBER})")


@dataclass(frozen=True)
class Measurements:
    """Rows of a table, in SI units."""

    kind: np.ndarray
    """(N,) names of `KINDS`."""
    radius: Float[np.ndarray, "N"]
    """Radius of the ball [m]."""
    humidity: Float[np.ndarray, "N"]
    """Relative humidity [%]."""
    gap: Float[np.ndarray, "N"]
    """Gap to the plate in a release, to the tool without contact [m]."""
    low: Float[np.ndarray, "N"]
    """Least value that agrees with the row [V] or [N]; that of `high` where it is known."""
    high: Float[np.ndarray, "N"]
    """Greatest value that agrees with the row [V] or [N]; infinity for "not up to `low`"."""
    repeats: Int[np.ndarray, "N"]
    """Number of balls; a known value is their mean, and `low` to `high` their range."""
    uncertainty: Float[np.ndarray, "N"]
    """Standard uncertainty of the reading, without the scatter of balls [V] or [N]."""
    probe_radius: Float[np.ndarray, "N"]
    """Radius of the tool [m]."""
    tip_curvature: Float[np.ndarray, "N"]
    """Radius of curvature of a rounded tip; infinity for a flat one [m]."""
    ball_density: Float[np.ndarray, "N"]
    """Density of the ball [kg/m^3]."""
    tool_ratio: Float[np.ndarray, "N"]
    """Work of adhesion to the tool by the row's materials, over that of the first row."""
    plate_ratio: Float[np.ndarray, "N"]
    """Work of adhesion to the plate by the row's materials, over that of the first row."""

    def __len__(self) -> int:
        return len(self.radius)

    @property
    def is_known(self) -> np.ndarray:
        """(N,) rows whose value is a number, not a range or a bound."""
        return (self.low == self.high) & (self.high > 0)

    @property
    def is_range(self) -> np.ndarray:
        """(N,) rows with the least and the greatest value of several balls."""
        return (self.low > 0) & (self.low < self.high) & np.isfinite(self.high) & (self.repeats > 1)

    def joined(self, further: "Measurements") -> "Measurements":
        """Return these rows and further ones."""
        columns = {
            field.name: np.concatenate([getattr(self, field.name), getattr(further, field.name)])
            for field in fields(self)
        }
        return Measurements(**columns)

    def chosen(self, rows: Any) -> "Measurements":
        """Return some of the rows, by a mask or by indices."""
        return Measurements(
            **{field.name: getattr(self, field.name)[rows] for field in fields(self)}
        )


def single_row(
    kind: str,
    radius: float,
    humidity: float,
    gap: float = RELEASE_GAP,
    probe_radius: float = PROBE_RADIUS,
    value: float = 1.0,
) -> Measurements:
    """Return a measurement of the default ball with a flat tip, in SI; its value is a placeholder."""
    density = materials.MATERIALS[materials.BALL].density
    numbers = {
        "radius": radius,
        "humidity": humidity,
        "gap": gap,
        "low": value,
        "high": value,
        "uncertainty": 0.0,
        "probe_radius": probe_radius,
        "tip_curvature": math.inf,
        "ball_density": density,
        "tool_ratio": 1.0,
        "plate_ratio": 1.0,
    }
    arrays = {name: np.array([number], float) for name, number in numbers.items()}
    return Measurements(kind=np.array([kind]), repeats=np.ones(1, int), **arrays)


def like_first(measurements: Measurements, row: Measurements) -> Measurements:
    """Return a row with tip and ball of the first row of a table."""
    names = ("probe_radius", "tip_curvature", "ball_density", "tool_ratio", "plate_ratio")
    return replace(row, **{name: getattr(measurements, name)[:1] for name in names})


def read_measurements(table: Any, units: Mapping[str, str] | None = None) -> Measurements:
    """Return the measurements of a table.

    Args:
        table: path of a CSV file, a mapping of columns, as also a pandas.DataFrame is, or a
            sequence of mappings. Columns have their units in their names, as `radius [um]`.
        units: units of columns whose names have none, as {"radius": "um"}.

    Raises:
        UserError: the table cannot be read, or a value is not allowed; the message names its line.
    """
    if isinstance(table, str | Path):
        name, header, rows = _rows_of_file(Path(table))
    else:
        name, header, rows = _rows_of_object(table)
    return _Reader(name, header, units or {}).read(rows)


class _Line(NamedTuple):
    """A row of a table."""

    number: int
    """Number of its line in the file, or of the row, from 1 on."""
    cells: Sequence[Any]


def _rows_of_file(path: Path) -> tuple[str, list[str], Iterator[_Line]]:
    """Return the name, the header and the rows of a CSV file."""
    text = read_text(path, "name a CSV file of measurements")
    lines = [
        (number, line)
        for number, line in enumerate(text.splitlines(), 1)
        if line.strip() and not line.lstrip().startswith("#")
    ]
    if not lines:
        raise UserError(
            f"{path} has no rows; its first line must name the columns, as "
            "`kind, radius [um], humidity [%], voltage [V]`"
        )
    delimiter = max(";\t,", key=lines[0][1].count)

    def cells(line: str) -> list[str]:
        try:
            return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter))]
        except csv.Error as error:
            raise UserError(f"{path} is no CSV ({error}); name a CSV file") from None

    def rows() -> Iterator[_Line]:
        for number, line in lines[1:]:
            line_cells = cells(line)
            if delimiter != ",":  # tables of countries with a decimal comma
                line_cells = [cell.replace(",", ".") for cell in line_cells]
            yield _Line(number, line_cells)

    return str(path), cells(lines[0][1]), rows()


def _rows_of_object(table: Any) -> tuple[str, list[str], Iterator[_Line]]:
    """Return the name, the header and the rows of columns or of mappings."""
    if hasattr(table, "keys"):
        header = [str(key) for key in table.keys()]  # noqa: SIM118 - of a DataFrame, too
        columns = [list(table[key]) for key in table.keys()]  # noqa: SIM118
        if len({len(column) for column in columns}) > 1:
            raise UserError("the columns of `table` have different lengths; make them equal")
        rows = zip(*columns, strict=True)
    else:
        mappings = list(table)
        header = list(dict.fromkeys(str(key) for row in mappings for key in row))
        rows = ([row.get(key, "") for key in header] for row in mappings)
    return "table", header, (_Line(number, cells) for number, cells in enumerate(rows, 1))


class _Reader:
    """Reads the rows of one table."""

    def __init__(self, name: str, header: Sequence[str], units: Mapping[str, str]):
        self._name = name
        self._columns: list[str] = []
        """Names of the columns in their order."""
        self._factors: dict[str, float] = {}
        """Units of the columns in SI."""
        units = {_canonical(column): unit for column, unit in units.items()}
        for text in header:
            self._add_column(text, units)
        for column in units:
            if column not in self._columns:
                raise UserError(
                    f"`units` names {column}, but {name} has only {', '.join(self._columns)}"
                )
        if "radius" not in self._columns:
            raise UserError(f"{name} has no column `radius [um]`; add the radius of the balls")
        if not {"voltage", "voltage_low", "force", "force_low"} & set(self._columns):
            raise UserError(f"{name} has no column `voltage [V]` or `force [nN]`; add one")
        for quantity in ("voltage", "force"):
            bounds = {f"{quantity}_low", f"{quantity}_high"} & set(self._columns)
            if quantity in self._columns and bounds:
                raise UserError(
                    f"{name} has a column {quantity} and a column {min(bounds)}; "
                    "use the first for all rows, as `20-30`, or the others"
                )

    def _add_column(self, text: str, units: Mapping[str, str]) -> None:
        """Take a column of the header with its unit."""
        match = _HEADER.fullmatch(text)
        column = _canonical(match[1] if match else text)
        if column not in COLUMNS and column not in _WORDS:
            known = [*COLUMNS, *_WORDS]
            similar = closest(column, known)
            hint = f"perhaps you meant {similar}" if similar else f"columns are {', '.join(known)}"
            raise UserError(f"{self._name} has a column {shown(text)!r}; {hint}")
        if column in self._columns:
            raise UserError(f"{self._name} has two columns for {column}; leave out one of them")
        self._columns.append(column)
        if column in _WORDS or not COLUMNS[column].units:
            return

        # Units are read in any case, as tables have rh [%rh] or gap [UM].
        allowed = COLUMNS[column].units
        unit = (match and match[2]) or units.get(column)
        example = COLUMNS[column].example
        if not unit:
            raise UserError(
                f"{self._name}: the column {column} has no unit; write it into the header, as "
                f"`{column} [{example}]`, or pass `units` {column}={example}"
            )
        factors = {name.lower(): factor for name, factor in allowed.items()}
        if unit.strip().lower() not in factors:
            raise UserError(
                f"{self._name}: the unit of {column} must be one of {', '.join(allowed)} "
                f"(got {shown(unit)})"
            )
        self._factors[column] = factors[unit.strip().lower()]

    def read(self, rows: Iterator[_Line]) -> Measurements:
        """Return the measurements."""
        lines = list(islice(rows, MAX_ROWS + 1))
        if len(lines) > MAX_ROWS:
            raise UserError(
                f"{self._name} has more than {MAX_ROWS} rows; give means with their `repeats`"
            )
        parsed = [self._row(line) for line in lines]
        if len(parsed) < 2:
            raise UserError(
                f"{self._name} has {len(parsed) or 'no'} row{'s' * (not parsed)}, which "
                "cannot show how balls scatter; give at least 2"
            )
        measurements = self._measurements(parsed)
        has_value = (measurements.low > 0) & np.isfinite(measurements.high)
        if not has_value.any():
            raise UserError(
                f"{self._name} has only bounds, such as '>50', and no measured value; "
                "add a row with a voltage at which a ball was lifted or released"
            )
        return measurements

    def _row(self, line: _Line) -> dict[str, Any]:
        """Return the values of a row by columns, in SI; empty cells are left out."""
        if len(line.cells) != len(self._columns):
            raise self._error(
                line, f"there must be {len(self._columns)} cells (got {len(line.cells)})"
            )
        row: dict[str, Any] = {"line": line}
        for column, cell in zip(self._columns, line.cells, strict=True):
            is_missing = cell is None or (isinstance(cell, float) and math.isnan(cell))
            if is_missing or str(cell).strip() == "":
                continue
            if column in _WORDS:
                row[column] = str(cell).strip()
            elif column in ("voltage", "force"):
                bounds = self._bounds(line, column, str(cell).strip())
                row[f"{column}_low"], row[f"{column}_high"] = bounds
            else:
                row[column] = self._number(line, column, str(cell).strip())
        return self._complete(line, row)

    def _number(self, line: _Line, column: str, text: str) -> float:
        """Return a number in SI."""
        try:
            value = float(text) * self._factors.get(column, 1.0)
        except ValueError:
            raise self._error(line, f"{column} must be a number (got {shown(text)})") from None
        allowed = COLUMNS[column].allowed
        if not allowed.allows(value):
            raise self._error(line, f"{column} must be {_in_unit(column, allowed)} (got {text})")
        return value

    def _bounds(self, line: _Line, column: str, text: str) -> tuple[float, float]:
        """Return the least and the greatest value of a cell such as 24, >50, or 20-30."""
        if match := _BOUND.fullmatch(text):
            bound = self._number(line, column, match[2])
            return (bound, math.inf) if match[1][0] in ">≥" else (0.0, bound)
        if match := _RANGE.fullmatch(text):
            return self._number(line, column, match[1]), self._number(line, column, match[2])
        value = self._number(line, column, text)
        return value, value

    def _complete(self, line: _Line, row: dict[str, Any]) -> dict[str, Any]:
        """Return a row with the defaults of what it does not have."""
        kind = self._kind(line, row.get("kind", "grasp"))
        row["kind"] = kind
        self._set_bounds(line, row)
        if "radius" not in row:
            raise self._error(line, "the radius of the ball is missing")
        if "humidity" not in row:
            raise self._error(line, "the humidity is missing; add a column `humidity [%]`")
        if kind == "no_contact" and "gap" not in row:
            raise self._error(
                line, "a lift without contact needs its gap to the tool; add a column `gap [um]`"
            )
        if kind == "no_contact" and "tip_curvature" in row:
            raise self._error(
                line,
                "there are no laws for rounded tips without contact; leave out the row, or its "
                "tip_curvature if the tip is flat",
            )
        gap = row.setdefault("gap", RELEASE_GAP)
        if kind in ACROSS_GAPS and gap > MAX_GAP_RATIO * row["radius"]:
            raise self._error(line, f"the gap must be at most {MAX_GAP_RATIO:g} times the radius")
        probe_ratio = row.get("probe_radius", PROBE_RADIUS) / row["radius"]
        if kind in ELECTRICAL and not PROBE_RATIOS.allows(probe_ratio):
            raise self._error(
                line,
                f"the radius of the tool must be {PROBE_RATIOS} times that of the ball "
                f"(got {probe_ratio:.3g}), since the laws hold there",
            )
        repeats = row.setdefault("repeats", 1.0)
        if repeats != int(repeats):
            raise self._error(line, f"repeats must be a whole number (got {repeats:g})")
        return row

    def _kind(self, line: _Line, text: str) -> str:
        """Return the kind of measurement that a cell names."""
        word = text.lower().replace(" ", "_").replace("-", "_")
        kind = _KIND_WORDS.get(word, word)
        if kind not in KINDS:
            raise self._error(line, f"kind must be one of {', '.join(KINDS)} (got {shown(text)})")
        return kind

    def _set_bounds(self, line: _Line, row: dict[str, Any]) -> None:
        """Set the least and the greatest value of a row, in place."""
        kind = row["kind"]
        quantity, other = ("force", "voltage") if kind in FORCES else ("voltage", "force")
        for bound in ("low", "high"):
            if f"{quantity}_{bound}" in row:
                row[bound] = row[f"{quantity}_{bound}"]
        if "low" not in row and "high" not in row:
            has_other = not {other, f"{other}_low", f"{other}_high"}.isdisjoint(row)
            reason = f", not a {other}" if has_other else ""
            raise self._error(line, f"a row of {kind} needs a {quantity}{reason}")
        row.setdefault("low", 0.0)
        row.setdefault("high", math.inf)
        if kind in FORCES:
            row["uncertainty"] = row.get("force_uncertainty", 0.0)
        if row["low"] > row["high"]:
            raise self._error(line, f"the least {quantity} must not exceed the greatest")

    def _measurements(self, rows: Sequence[Mapping[str, Any]]) -> Measurements:
        """Return complete rows as arrays."""

        def column(name: str, default: float) -> np.ndarray:
            return np.array([row.get(name, default) for row in rows], float)

        tool_work, plate_work, density = np.transpose([self._materials(row) for row in rows])
        return Measurements(
            kind=np.array([row["kind"] for row in rows]),
            radius=column("radius", math.nan),
            humidity=column("humidity", math.nan),
            gap=column("gap", math.nan),
            low=column("low", math.nan),
            high=column("high", math.nan),
            repeats=column("repeats", 1.0).astype(int),
            uncertainty=column("uncertainty", 0.0),
            probe_radius=column("probe_radius", PROBE_RADIUS),
            tip_curvature=column("tip_curvature", math.inf),
            ball_density=np.array(
                [row.get("ball_density", of_row) for row, of_row in zip(rows, density, strict=True)]
            ),
            tool_ratio=tool_work / tool_work[0],
            plate_ratio=plate_work / plate_work[0],
        )

    def _materials(self, row: Mapping[str, Any]) -> tuple[float, float, float]:
        """Return relative works of adhesion to tool and plate, and the ball's density."""
        names = (materials.BALL, materials.TOOL, materials.PLATE)
        try:
            ball, tool, plate = (
                materials.material(column, row.get(column, usual), usual)
                for column, usual in zip(MATERIALS, names, strict=True)
            )
        except ConfigError as error:
            raise self._error(row["line"], str(error)) from None
        return (
            materials.work_ratio(ball, tool, materials.BALL, materials.TOOL),
            materials.work_ratio(ball, plate, materials.BALL, materials.PLATE),
            ball.density,
        )

    def _error(self, line: _Line, fact: str) -> UserError:
        place = "row" if self._name == "table" else "line"
        return UserError(f"{self._name}, {place} {line.number}: {fact}")


def _canonical(text: str) -> str:
    """Return the name of a column that a user writes."""
    word = text.strip().lower().replace(" ", "_").replace("-", "_")
    return _NAMES.get(word, word)


def _in_unit(column: str, allowed: Within) -> str:
    """Return limits in the usual unit of a column."""
    example = COLUMNS[column].example
    factor = COLUMNS[column].units.get(example, 1.0)
    return str(Within(allowed.low / factor, allowed.high / factor, example))


def example_table() -> Path:
    """Return the path of the paper's voltages as a table, which is the example."""
    return Path(__file__).parent / "tables" / "valdastri2006.csv"
