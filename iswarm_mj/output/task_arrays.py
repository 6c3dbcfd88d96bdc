"""What a task wants seen of each step: its areas on the floor, its metrics. Cleaning's are those of `Frames` itself."""

from collections.abc import Callable
from typing import Any

import jax
import numpy as np
from jaxtyping import Float

from iswarm_mj.config import SwarmConfig
from iswarm_mj.output.schema import ARRAYS
from iswarm_mj.output.trajectory import AREA, METRIC
from iswarm_mj.tasks.protocol import DrawnTask, Look, Quantity, Task
from iswarm_mj.utils.units import MM

FIXED = ("dump", "dust_areas")
"""Areas that stay where they are: arrays of `Scene`."""
_BLOCK = 64
"""Steps of a program, which is compiled for as many."""

Watch = Callable[[Any], dict[str, np.ndarray]]
"""From the states of a task after T steps to arrays (T, ...) by their names in a trajectory, areas in m."""


def looks(task: Task) -> dict[str, Look]:
    """Return how areas are drawn that may change from step to step."""
    return {name: look for name, look in getattr(task, "drawn", {}).items() if name not in FIXED}


def quantities(task: Task) -> dict[str, Quantity]:
    """Return metrics that trajectories have beside those of `Frames`."""
    return {name: quantity for name, quantity in getattr(task, "measured", {}).items() if name not in ARRAYS}


def watch(task: Task, config: SwarmConfig) -> Watch:
    """Return what reads areas and metrics of a task in worlds of this configuration."""
    areas, metrics = looks(task), quantities(task)
    if not areas and not metrics:
        return lambda state: {}

    @jax.jit
    @jax.vmap
    def read(state: Any) -> dict[str, jax.Array]:
        shapes = task.areas(config, state) if areas and isinstance(task, DrawnTask) else {}
        numbers = task.metrics(state) if metrics else {}
        return {AREA + name: shapes[name] * MM for name in areas} | {METRIC + name: numbers[name] for name in metrics}

    def of_steps(state: Any) -> dict[str, np.ndarray]:
        n_steps = len(jax.tree.leaves(state)[0])
        rows = np.minimum(np.arange(-(-n_steps // _BLOCK) * _BLOCK), n_steps - 1).reshape(-1, _BLOCK)
        parts = [read(jax.tree.map(lambda a, block=block: np.asarray(a)[block], state)) for block in rows]
        return {name: np.concatenate([part[name] for part in parts])[:n_steps] for name in parts[0]}

    return of_steps


def fixed_areas(task: Task, config: SwarmConfig, state: Any) -> dict[str, Float[np.ndarray, "A 4"]]:
    """Return rectangles x_min, y_min, x_max, y_max [m] of the dump and of dust areas, as far as the task has them."""
    if not isinstance(task, DrawnTask) or not any(name in task.drawn for name in FIXED):
        return {}
    found = task.areas(config, state)
    shapes = {name: np.asarray(found[name], float) * MM for name in FIXED if name in found}
    return {name: np.hstack([a[:, :2] - a[:, 2:], a[:, :2] + a[:, 2:]]) for name, a in shapes.items()}
