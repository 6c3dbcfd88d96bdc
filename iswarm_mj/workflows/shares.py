"""Shares of the worlds of a run, each computed by a machine of a Ray cluster, and what they came to."""

import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from importlib.machinery import PathFinder
from itertools import pairwise
from typing import Any

from iswarm_mj.output.results import Share, share_of
from iswarm_mj.simulation.run import Run
from iswarm_mj.utils.constraints import check
from iswarm_mj.utils.errors import SimulationFault
from iswarm_mj.utils.pool import connected
from iswarm_mj.workflows.recorder import advanced


def parts(n_worlds: int, count: int, recorded: Sequence[int] = ()) -> list[list[int]]:
    """Return the numbers of the worlds of each share; the first has those that are recorded.

    Raises:
        ConfigError: there are fewer worlds than shares, or more are recorded than the first share can have.
    """
    check("worlds", n_worlds, f"at least {count}, one for each of `hosts`", n_worlds >= count)
    most = -(-n_worlds // count)
    allowed = f"at most {most} worlds, the share of the machine that writes the results"
    check("record_worlds", tuple(recorded), allowed, len(recorded) <= most)
    order = [*recorded, *(world for world in range(n_worlds) if world not in recorded)]
    ends = [n_worlds // count * k + min(k, n_worlds % count) for k in range(count + 1)]
    return [sorted(order[first:last]) for first, last in pairwise(ends)]


@contextmanager
def computed(makers: Sequence[Callable[[], Run]], own: Sequence[Any] = ()) -> Iterator[Callable[[], list[Share]]]:
    """Have runs computed by other machines; leaving the block ends those that still go on.

    Args:
        makers: make the runs there; they hold no devices, since they take all that they find.
        own: a strategy and a task whose classes may be in files that only this machine has.

    Yields:
        A function that waits for the shares, in the order of the runs, and returns them.

    Raises:
        UserError: Ray is not installed, or a run is not possible.
        SimulationFault: a machine was lost.
    """
    if not makers:
        yield list
        return
    ray = connected()
    for module in {type(each).__module__ for each in own} & sys.modules.keys():
        if PathFinder.find_spec(module.partition(".")[0]) is None:
            ray.cloudpickle.register_pickle_by_value(sys.modules[module])
    import jax

    n_gpus = sum(device.platform == "gpu" for device in jax.local_devices())
    remote = ray.remote(num_cpus=1, num_gpus=n_gpus, max_retries=0, scheduling_strategy="SPREAD")(_compute)
    running = [remote.remote(make) for make in makers]

    def wait() -> list[Share]:
        try:
            return ray.get(running)
        except ray.exceptions.RayTaskError as error:
            raise error.cause from None
        except ray.exceptions.RayError as error:
            reason = str(error).partition("\n")[0]
            raise SimulationFault(f"a machine that computed a share of the worlds was lost ({reason})") from None

    try:
        yield wait
    finally:
        for task in running:
            ray.cancel(task, force=True)


def _compute(make: Callable[[], Run]) -> Share:
    """Take all steps of a run."""
    run = make()
    for _ in advanced(run):
        pass
    return share_of(run)
