"""Print how long reading, likelihood and fit of tables take.

    python tools/benchmarks/time_fit.py

Tables are those of a synthetic laboratory: grasps and releases of single balls.
"""

import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from iswarm_mj.gripper.fitting.fit import fit
from iswarm_mj.gripper.fitting.likelihood import Likelihood
from iswarm_mj.gripper.fitting.parameters import Model
from iswarm_mj.gripper.fitting.table import read_measurements
from iswarm_mj.gripper.laws.detachment import (
    WORK_OBJECT_SUBSTRATE,
    WORK_TOOL_OBJECT,
    grasp_voltage,
    release_voltage,
)

NUMBERS = (100, 10_000, 100_000)
"""Numbers of rows."""


def write_table(path: Path, n_rows: int) -> None:
    """Write a table, half of which are releases."""
    random = np.random.default_rng(0)
    radius = random.uniform(15e-6, 25e-6, n_rows)
    work_tool = WORK_TOOL_OBJECT * random.normal(1, 0.12, n_rows)
    work_plate = WORK_OBJECT_SUBSTRATE * random.normal(1, 0.16, n_rows)
    voltages = {
        "grasp": grasp_voltage(radius, work_tool, work_plate),
        "release": release_voltage(radius, work_tool),
    }
    lines = ["kind,radius [um],humidity [%],voltage [V]"]
    for row in range(n_rows):
        kind = ("grasp", "release")[row % 2]
        lines.append(f"{kind},{1e6 * radius[row]:.4f},10,{voltages[kind][row]:.3f}")
    path.write_text("\n".join(lines))


def timed(function: Callable[[], Any]) -> tuple[float, Any]:
    """Return the time that a function takes [s], and its result."""
    start = time.perf_counter()
    result = function()
    return time.perf_counter() - start, result


def main() -> None:
    """Print a line for each number of rows."""
    with tempfile.TemporaryDirectory() as directory:
        path = Path(directory) / "table.csv"
        for n_rows in NUMBERS:
            write_table(path, n_rows)
            reading, rows = timed(partial(read_measurements, path))
            likelihood = Likelihood(rows, Model())
            places = np.zeros(len(likelihood.model.free))
            likelihood.objective(places)  # which prepares the laws
            evaluation, _ = timed(partial(likelihood.objective, places))
            fitting, _ = timed(partial(fit, path))
            print(f"| {n_rows} | {reading:.2f} | {1e3 * evaluation:.1f} | {fitting:.1f} |")


if __name__ == "__main__":
    main()
