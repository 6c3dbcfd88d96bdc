"""Tables of a tip's forces for the plugins in C and in MJX, and their files.

The table is that of `laws.probe_table`, with the tip in place of the flat probe: shape factors over
log2(D/R) and log2(R_m/R), where the whole tip is scaled with its greatest radius R_m. A model's geom
of the probe has this radius, so that the ratio stands for balls of another radius R at one tip.
Splines add less than 3e-4 to the error of the boundary elements (`tests/gripper/test_tip_table.py`).

Capacitances follow from the forces, as those of the flat probe do, so that work and energy agree.
"""

import json
import math
from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from iswarm_mj.gripper.laws import spline
from iswarm_mj.gripper.laws.detachment import (
    BALL_DENSITY,
    grasp_deficit,
    least_voltage,
    release_deficit,
)
from iswarm_mj.gripper.laws.probe_table import (
    GAP_EXPONENTS,
    axis_of,
    capacitance_coefficients,
    coefficients_of,
)
from iswarm_mj.gripper.tips.adhesion import adhesion_radius
from iswarm_mj.gripper.tips.forces import Task, shape_factor
from iswarm_mj.gripper.tips.profile import Chain, Profile
from iswarm_mj.gripper.units import VACUUM_PERMITTIVITY
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.files import atomic_write, read_json
from iswarm_mj.utils.pool import unordered
from iswarm_mj.utils.scalar_backends import in_arrays

LEAST_BALL, LARGEST_BALL = 10e-6, 50e-6
"""Radii of the balls that a table is for [m]."""
N_RATIOS = 9
"""Number of ratios R_m/R in a table."""
_TASKS: tuple[Task, ...] = ("pick", "release")
_REMEDY = "name the tip.json that `iswarm tip --table` writes"


@dataclass(frozen=True, eq=False)
class TipTable:
    """Forces of a tip on balls of `LEAST_BALL` to `LARGEST_BALL`."""

    profile: Profile
    reach: float
    """Reach of the adhesion [m]."""
    pick: Float[np.ndarray, "gaps ratios"]
    """Shape factors F D / (R pi eps0 V^2) of the pull to the tip."""
    release: Float[np.ndarray, "gaps ratios"]
    """Shape factors of the pull to the plate."""

    @cached_property
    def exponents(self) -> Float[np.ndarray, "ratios"]:
        """Values of log2(R_m/R) in the table."""
        return ratio_exponents(self.profile.radius)

    @cached_property
    def tables(self) -> tuple[Float[np.ndarray, "4 R C"], Float[np.ndarray, "2 5"]]:
        """Splines and axes, as of `probe_table.tables`."""
        axes = np.array([axis_of(GAP_EXPONENTS), axis_of(self.exponents)])
        forces = [coefficients_of(self.pick), coefficients_of(self.release)]
        capacitances = [
            capacitance_coefficients(task, coefficients, self.exponents)
            for task, coefficients in zip(_TASKS, forces, strict=True)
        ]
        return np.stack(forces + capacitances), axes

    def force(self, task: Task, radius: float, gap: float) -> float:
        """Return the force on a ball at 1 V [N/V^2].

        Args:
            task: "pick" or "release".
            radius: of the ball [m].
            gap: to the tip in "pick", to the plate in "release" [m].
        """
        splines, axes = self.tables
        functions = in_arrays(spline, np)
        ratio = self.profile.radius / radius
        place = functions.place_of(np.asarray(gap / radius), np.asarray(ratio), axes.tolist())
        factor = float(functions.value_at(splines[_TASKS.index(task)], place))
        return factor * math.pi * VACUUM_PERMITTIVITY * radius / gap

    def grasp_voltage(
        self,
        radius: float,
        work_tool: float,
        work_plate: float,
        gap: float,
        density: float = BALL_DENSITY,
    ) -> float:
        """Return the least voltage that lifts a ball [V].

        Args:
            radius: of the ball [m].
            work_tool: of adhesion between tool and ball, times `adhesion_share` [J/m^2].
            work_plate: of adhesion between ball and plate [J/m^2].
            gap: electrical gap of tip and ball [m].
            density: of the ball [kg/m^3].
        """
        deficit = grasp_deficit(radius, work_tool, work_plate, density)
        return float(least_voltage(deficit, self.force("pick", radius, gap)))

    def release_voltage(
        self, radius: float, work_tool: float, gap: float, density: float = BALL_DENSITY
    ) -> float:
        """Return the least voltage that drops a ball [V].

        Args:
            radius: of the ball [m].
            work_tool: of adhesion between tool and ball, times `adhesion_share` [J/m^2].
            gap: of ball and plate [m].
            density: of the ball [kg/m^3].
        """
        deficit = release_deficit(radius, work_tool, density)
        return float(least_voltage(deficit, self.force("release", radius, gap)))

    def adhesion_share(self, radius: float) -> float:
        """Return the adhesion of a ball [m] to the tip, over that to a plane."""
        return adhesion_radius(self.profile, radius, self.reach) / radius


def ratio_exponents(tip_radius: float) -> Float[np.ndarray, "ratios"]:
    """Return the values of log2(R_m/R) for a tip [m], of equal steps."""
    first = math.log2(tip_radius / LARGEST_BALL)
    last = math.log2(tip_radius / LEAST_BALL)
    return np.linspace(first, last, N_RATIOS)


def factor_at(profile: Profile, row: int, column: int, task: Task) -> tuple[int, int, Task, float]:
    """Return a place of a table, and the shape factor there."""
    radius = profile.radius / 2.0 ** ratio_exponents(profile.radius)[column]
    gap = 2.0 ** GAP_EXPONENTS[row] * radius
    return row, column, task, shape_factor(profile, radius, gap, task)


def make_table(
    profile: Profile,
    reach: float,
    workers: int = 0,
    note: Callable[[], None] = lambda: None,
) -> TipTable:
    """Return the table of a tip, by boundary elements.

    Args:
        profile: of the tip.
        reach: of the adhesion [m].
        workers: processes; the result does not depend on it.
        note: called after each entry.

    Raises:
        UserError: a force has the wrong sign, which the logarithm in the splines cannot take.
    """
    values = {task: np.zeros((len(GAP_EXPONENTS), N_RATIOS)) for task in _TASKS}
    jobs = [
        (profile, row, column, task)
        for task in _TASKS
        for row in range(len(GAP_EXPONENTS))
        for column in range(N_RATIOS)
    ]
    for row, column, task, factor in unordered(factor_at, jobs, workers):
        values[task][row, column] = factor
        note()
    if min(values["pick"].min(), values["release"].min()) <= 0:
        raise UserError(
            "this tip pushes some balls away or pulls them back at some gap, "
            "for which there is no table; choose a flatter one"
        )
    return TipTable(profile, reach, values["pick"], values["release"])


def n_entries() -> int:
    """Return the number of entries of a table, for progress."""
    return len(_TASKS) * len(GAP_EXPONENTS) * N_RATIOS


def write_table(table: TipTable, path: Path) -> None:
    """Write a table as JSON."""
    face = {
        name: np.asarray(values).tolist() for name, values in asdict(table.profile.face).items()
    }
    content = {
        "tip_table": 1,
        "name": table.profile.name,
        "apex_curvature": table.profile.apex_curvature,
        "face": face,
        "reach": table.reach,
        "pick": table.pick.tolist(),
        "release": table.release.tolist(),
    }
    with atomic_write(path) as part:
        part.write_text(json.dumps(content) + "\n", encoding="utf-8")


def read_table(path: Path | str) -> TipTable:
    """Return the table in a file, the same one for as long as the file does not change.

    Raises:
        UserError: it cannot be read, or is no table of a tip.
    """
    path = Path(path)
    try:
        time = path.stat().st_mtime_ns
    except OSError:
        time = 0  # for which reading finds the words
    return _table_of(path.absolute(), time)


@lru_cache(maxsize=8)
def _table_of(path: Path, _time: int) -> TipTable:
    """Return the table in a file."""
    content = read_json(path, _REMEDY)
    try:
        return _from_json(content)
    except (KeyError, TypeError, ValueError, AttributeError):
        raise UserError(f"{path} is no table of a tip; {_REMEDY}") from None


def _from_json(content: Any) -> TipTable:
    """Return the table that `write_table` has written.

    Raises:
        KeyError, TypeError, ValueError, AttributeError: it has not written that.
    """
    if content["tip_table"] != 1:
        raise ValueError("another version")

    columns = {name: np.array(values, float) for name, values in content["face"].items()}
    face = Chain(**columns)
    has_equal_lengths = all(values.shape == (len(face.length),) for values in columns.values())
    if not has_equal_lengths or len(face.length) == 0:
        raise ValueError("pieces of the face lack numbers")

    shape = (len(GAP_EXPONENTS), N_RATIOS)
    table = TipTable(
        profile=Profile(content["name"], face, float(content["apex_curvature"])),
        reach=float(content["reach"]),
        pick=np.array(content["pick"], float).reshape(shape),
        release=np.array(content["release"], float).reshape(shape),
    )
    are_positive = [table.profile.radius > 0, table.reach > 0, table.pick > 0, table.release > 0]
    if not all(map(np.all, are_positive)):
        raise ValueError("a radius, a reach or a force is not above 0")
    return table
