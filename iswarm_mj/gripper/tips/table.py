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
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from iswarm_mj.gripper.laws import spline
from iswarm_mj.gripper.laws.detachment import (
    BALL_DENSITY,
    CONTACT_GAP,
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
from iswarm_mj.utils.arrays import Array, Quantity, array_module
from iswarm_mj.utils.constraints import check
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.files import atomic_write, read_json
from iswarm_mj.utils.pool import unordered
from iswarm_mj.utils.scalar_backends import in_arrays

LEAST_BALL, LARGEST_BALL = 10e-6, 50e-6
"""Radii of the balls that a table is for [m]."""
N_RATIOS = 9
"""Number of ratios R_m/R in a table."""
_N_SHARES = 65
"""Number of balls whose adhesion is computed; that of others is interpolated."""
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

    @cached_property
    def digest(self) -> str:
        """SHA-256 of the numbers, by which results name the table."""
        return sha256(json.dumps(self.to_json()).encode()).hexdigest()

    def to_json(self) -> dict[str, Any]:
        """Return the content of the table's file."""
        face = {
            name: np.asarray(values).tolist() for name, values in asdict(self.profile.face).items()
        }
        return {
            "tip_table": 1,
            "name": self.profile.name,
            "apex_curvature": self.profile.apex_curvature,
            "face": face,
            "reach": self.reach,
            "pick": self.pick.tolist(),
            "release": self.release.tolist(),
        }

    def force(self, task: Task, radius: Quantity, gap: Quantity) -> Quantity:
        """Return the force on a ball at 1 V [N/V^2].

        Args:
            task: "pick" or "release".
            radius: of the ball [m].
            gap: to the tip in "pick", to the plate in "release" [m].
        """
        xp = array_module(radius, gap)
        functions = in_arrays(spline, xp)
        splines, axes = self.tables

        gap_ratio = xp.asarray(gap / radius)
        tip_ratio = xp.asarray(self.profile.radius / radius)
        place = functions.place_of(gap_ratio, tip_ratio, axes.tolist())
        coefficients = xp.asarray(splines[_TASKS.index(task)], dtype=gap_ratio.dtype)
        factor = functions.value_at(coefficients, place)
        return factor * math.pi * VACUUM_PERMITTIVITY * (radius / gap)

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

    def is_grasped(
        self,
        voltage: Quantity,
        radius: Quantity,
        work_tool: Quantity,
        work_plate: Quantity,
        gap: float = CONTACT_GAP,
    ) -> bool | Bool[Array, "..."]:
        """Return whether the touching tip lifts a ball, as `laws.detachment.is_grasped`.

        Args:
            voltage: of the tip [V].
            radius: of the ball [m].
            work_tool: of adhesion between tool and ball, times `adhesion_share` [J/m^2].
            work_plate: of adhesion between ball and plate [J/m^2].
            gap: electrical gap of tip and ball [m].
        """
        pull = voltage**2 * self.force("pick", radius, gap)
        return pull > grasp_deficit(radius, work_tool, work_plate)

    def is_released(
        self, voltage: Quantity, radius: Quantity, work_tool: Quantity, gap: float
    ) -> bool | Bool[Array, "..."]:
        """Return whether a held ball leaves the tip, as `laws.detachment.is_released`.

        Args:
            voltage: of the tip [V].
            radius: of the ball [m].
            work_tool: of adhesion between tool and ball, times `adhesion_share` [J/m^2].
            gap: of ball and plate [m].
        """
        pull = voltage**2 * self.force("release", radius, gap)
        return pull > release_deficit(radius, work_tool)

    def adhesion_share(self, radius: float) -> float:
        """Return the adhesion of a ball [m] to the tip, over that to a plane."""
        return adhesion_radius(self.profile, radius, self.reach) / radius

    def adhesion_shares(self, radius: Float[np.ndarray, "K"]) -> Float[np.ndarray, "K"]:
        """Return the `adhesion_share` of many balls [m], interpolated to 3e-3."""
        grid, shares = self._grid_of_shares
        return np.interp(radius, grid, shares)

    @cached_property
    def _grid_of_shares(self) -> tuple[Float[np.ndarray, "n"], Float[np.ndarray, "n"]]:
        """Radii close together [m], and the adhesion of balls with these."""
        grid = np.geomspace(LEAST_BALL, LARGEST_BALL, _N_SHARES)
        return grid, np.array([self.adhesion_share(radius) for radius in grid])


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
    with atomic_write(path) as part:
        part.write_text(json.dumps(table.to_json()) + "\n", encoding="utf-8")


def read_table(path: Path | str) -> TipTable:
    """Return the table in a file, the same one for as long as the file does not change.

    Raises:
        UserError: it cannot be read, or is no table of a tip.
    """
    return _table_of(Path(path).absolute(), time_of_change(path))


def check_unchanged(path: Path | str, digest: str) -> None:
    """Check that a file has the table that a recorded run had.

    Args:
        path: of the table.
        digest: `TipTable.digest` of the run's table.

    Raises:
        UserError: it has another one, or cannot be read.
    """
    if read_table(path).digest != digest:
        raise UserError(
            f"{path} is not the table that the run had; put that one there, or name another "
            "`gripper.tip`"
        )


def check_balls(name: str, radius: float) -> None:
    """Check that tables are for balls of a radius.

    Args:
        name: setting of the radius, for the message.
        radius: of the ball [m].

    Raises:
        ConfigError: they are not.
    """
    is_in_table = LEAST_BALL <= radius <= LARGEST_BALL
    check(
        name, radius, f"from {LEAST_BALL:g} to {LARGEST_BALL:g} m with a `gripper.tip`", is_in_table
    )


def time_of_change(path: Path | str) -> int:
    """Return the time of a file's last change [ns]; 0 if it cannot be read."""
    try:
        return Path(path).stat().st_mtime_ns
    except OSError:
        return 0  # reading the file finds the words


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
