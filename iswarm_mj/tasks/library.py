"""Tasks by name: of a class in a file, or of an entry point of an installed package."""

from typing import Any

from iswarm_mj.strategy.library import Offer, find

TASKS = Offer("task", "tasks", "lay_out", "gather.py:Gather", "iswarm_mj.tasks.protocol")


def find_task(name: str) -> Any:
    """Return a class of tasks, or an object whose values are defaults, see `strategy.library.find`."""
    return find(TASKS, name)
