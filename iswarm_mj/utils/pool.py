"""Calls in worker processes of this machine, or of a Ray cluster.

A worker of this machine runs `utils.worker`. It is not started by `multiprocessing`, which would
run the user's script again in each worker unless the script is guarded, nor by joblib, which
replaces workers that have grown by 300 MB: compiled programs take as much.
"""

import atexit
import logging
import os
import subprocess
import sys
import warnings
from collections.abc import Callable, Generator, Iterable
from itertools import islice
from multiprocessing import Pipe
from multiprocessing.connection import wait
from typing import Any, Literal

from iswarm_mj.utils.errors import SimulationFault
from iswarm_mj.utils.extras import naming_extras
from iswarm_mj.utils.operating_system import inheriting, most_workers, n_usable_cores, own_group
from iswarm_mj.utils.signals import kept_handlers

Backend = Literal["processes", "ray"]
_VARIABLES = {"JAX_PLATFORMS": "cpu", "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
"""Environment variables of workers: each has one core, and no GPU."""


def unordered(
    call: Callable[..., Any],
    arguments: Iterable[tuple[Any, ...]],
    workers: int = 0,
    backend: Backend = "processes",
) -> Generator[Any, None, None]:
    """Yield the results of calls as they finish, in any order.

    Closing the generator stops the workers that are busy.

    Args:
        call: function of a module.
        arguments: its arguments in each call, in the order in which the calls begin.
        workers: number of calls at a time; 0 for one per core, of the cluster with Ray; 1 for this
            process itself.
        backend: processes of this machine, which stay for the next calls and see no GPU; or ray,
            the cluster at RAY_ADDRESS.

    Raises:
        SimulationFault: a worker was lost.
        UserError: Ray is not installed.
        Exception: whatever a call raises.
    """
    if backend == "ray":
        return _on_ray(call, arguments, workers)
    n_workers = most_workers(workers or n_usable_cores())
    if n_workers == 1:
        return (call(*each) for each in arguments)
    return _in_processes(call, arguments, n_workers)


class _Worker:
    """Process that makes calls, one at a time, and ends with this one.

    Ctrl-C on a terminal reaches the processes of one group, and this one only: it stops its workers
    itself.
    """

    def __init__(self):
        self.connection, end_for_calls = Pipe()
        # The worker ends when this process closes the lifeline, or ends itself.
        end_of_lifeline, self._lifeline = Pipe(duplex=False)
        inherited = [end_for_calls, end_of_lifeline]
        numbers = [str(end.fileno()) for end in inherited]
        python_path = os.pathsep.join(sys.path)
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-m", "iswarm_mj.utils.worker", *numbers],
            stdin=subprocess.DEVNULL,
            env={**os.environ, **_VARIABLES, "PYTHONPATH": python_path},
            **inheriting(inherited),
            **own_group(),
        )
        for end in inherited:
            end.close()

    @property
    def is_alive(self) -> bool:
        """True while the process runs."""
        return self._process.poll() is None

    def begin(self, call: Callable[..., Any], arguments: tuple[Any, ...]) -> None:
        """Begin a call.

        Raises:
            SimulationFault: the worker is lost.
        """
        try:
            self.connection.send((call, arguments))
        except OSError:
            raise _lost() from None

    def result(self) -> Any:
        """Wait for the result of the call that was begun, and return it.

        Raises:
            SimulationFault: the worker is lost.
            Exception: whatever the call raises.
        """
        try:
            result, error = self.connection.recv()
        except (EOFError, OSError):
            raise _lost() from None
        if error is not None:
            raise error
        return result

    def stop(self) -> None:
        """End the process, whatever it does."""
        self._process.kill()
        self._process.wait()
        self.connection.close()
        self._lifeline.close()


_idle: list[_Worker] = []
"""Workers that wait for the next calls."""


@atexit.register
def _stop_idle() -> None:
    """Stop the workers that wait."""
    while _idle:
        _idle.pop().stop()


def _waiting_worker() -> _Worker:
    """Return a worker that waits, or else a new one."""
    while _idle:
        worker = _idle.pop()
        if worker.is_alive:
            return worker
        worker.stop()
    return _Worker()


def _in_processes(
    call: Callable[..., Any], arguments: Iterable[tuple[Any, ...]], n_workers: int
) -> Generator[Any, None, None]:
    """Yield the results of calls in worker processes."""
    remaining = iter(arguments)
    busy: dict[Any, _Worker] = {}
    try:
        for first in islice(remaining, n_workers):
            worker = _waiting_worker()
            busy[worker.connection] = worker
            worker.begin(call, first)

        while busy:
            for connection in wait(list(busy)):
                worker = busy[connection]
                result = worker.result()
                following = next(remaining, None)
                if following is None:
                    _idle.append(busy.pop(connection))
                else:
                    worker.begin(call, following)
                yield result
    finally:
        for worker in busy.values():
            worker.stop()


def _on_ray(
    call: Callable[..., Any], arguments: Iterable[tuple[Any, ...]], workers: int
) -> Generator[Any, None, None]:
    """Yield the results of calls on a Ray cluster."""
    ray = _connected(workers)
    options = {"num_cpus": 1, "max_retries": 0, "runtime_env": {"env_vars": _VARIABLES}}
    remote = ray.remote(**options)(call)
    remaining = list(arguments)[::-1]
    running = []
    try:
        while remaining or running:
            while remaining and (not workers or len(running) < workers):
                running.append(remote.remote(*remaining.pop()))
            (done, *_), running = ray.wait(running)
            yield ray.get(done)
    except ray.exceptions.RayTaskError as error:
        raise error.cause from None
    except ray.exceptions.RayError:
        raise _lost() from None
    finally:
        for task in running:
            ray.cancel(task, force=True)


def _connected(workers: int) -> Any:
    """Return Ray, connected to the cluster at RAY_ADDRESS, or to a new one of this machine.

    Args:
        workers: cores of a new cluster; 0 for all.

    Raises:
        UserError: Ray is not installed.
    """
    with naming_extras():
        import ray  # pyright: ignore[reportMissingImports]
    if ray.is_initialized():
        return ray

    options: dict[str, Any] = {"logging_level": logging.ERROR, "log_to_driver": False}
    if not os.environ.get("RAY_ADDRESS"):
        options |= {"num_cpus": workers or None, "include_dashboard": False}
    # Otherwise Ray sends statistics of its usage to its makers.
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    with kept_handlers(), warnings.catch_warnings():
        # JAX warns of each fork, but Ray's children start another program at once.
        warnings.simplefilter("ignore", RuntimeWarning)
        ray.init(**options)
    return ray


def _lost() -> SimulationFault:
    return SimulationFault(
        "a worker process was lost, perhaps since there is too little memory; finished runs are "
        "kept: start the command again with fewer workers"
    )
