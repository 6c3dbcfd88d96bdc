"""Calls in worker processes, of this machine or of a Ray cluster, by joblib."""

import logging
import os
import signal
import threading
import time
import warnings
from collections.abc import Callable, Generator, Iterable
from typing import Any, Literal, cast

from joblib import Parallel, cpu_count, delayed
from joblib.externals.loky import process_executor
from joblib.externals.loky.process_executor import BrokenProcessPool

from iswarm_mj.utils.errors import SimulationFault, UserError
from iswarm_mj.utils.signals import kept_handlers

Backend = Literal["processes", "ray"]
_MOST_GROWTH = 4_000_000_000
"""Bytes by which a worker may grow before joblib starts another in its place. Joblib's 300 MB are
too few: programs for five numbers of robots take as much, and the other worker would compile them
anew."""
_HALF_WRITTEN = r"Error reading persistent compilation cache entry for .*truncated stream"


def unordered(
    call: Callable[..., Any],
    given: Iterable[tuple[Any, ...]],
    workers: int = 0,
    backend: Backend = "processes",
) -> Generator[Any, None, None]:
    """Yield the results of calls as they finish, in whichever order; closing the generator stops
    the workers.

    Args:
        call: a function of a module.
        given: its arguments in each call, in the order in which the calls begin.
        workers: calls at a time; 0 for one per core, of the cluster with Ray; 1 for this process
            itself.
        backend: processes of this machine, which stay for the next call and see no GPU; or ray, the
            cluster at RAY_ADDRESS.

    Raises:
        SimulationFault: a worker was lost.
        UserError: Ray is not installed.
        Exception: whatever a call raises.
    """
    if backend == "ray":
        return _on_ray(call, given, workers)
    return _in_processes(call, given, workers or cpu_count())


def _in_processes(
    call: Callable[..., Any], given: Iterable[tuple[Any, ...]], workers: int
) -> Generator[Any, None, None]:
    options: dict[str, Any] = (
        {"initializer": _begin, "initargs": (os.getpid(),)} if workers > 1 else {}
    )
    warnings.filterwarnings(
        "ignore", "A worker stopped while some jobs", UserWarning
    )  # one that has grown so much
    pool = Parallel(workers, "loky", "generator_unordered", batch_size=cast(Any, 1), **options)
    try:  # the pool may break while it hands over the first calls, too
        results = cast(
            Generator[Any, None, None], pool(delayed(call)(*arguments) for arguments in given)
        )
        try:
            for result in results:  # noqa: UP028, since `yield from` would close them here, with a warning
                yield result
        finally:
            _close(results)
    except BrokenProcessPool:
        raise _lost() from None


def _close(results: Generator[Any, None, None]) -> None:
    """Stop the calls that are left, without the warnings of joblib and the error of its thread."""
    hook = (
        threading.excepthook
    )  # joblib's thread may end by a KeyError when it has just accepted a call
    threading.excepthook = lambda error: None if error.exc_type is KeyError else hook(error)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # that not all results were taken
        results.close()
    threading.excepthook = hook


def _on_ray(
    call: Callable[..., Any], given: Iterable[tuple[Any, ...]], workers: int
) -> Generator[Any, None, None]:
    # Not by joblib's backend for Ray, which has no generators.
    ray = _connected(workers)
    remote = ray.remote(
        num_cpus=1, max_retries=0, runtime_env={"env_vars": {"JAX_PLATFORMS": "cpu"}}
    )(call)
    left, running = list(given)[::-1], []
    try:
        while left or running:
            while left and (not workers or len(running) < workers):
                running.append(remote.remote(*left.pop()))
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
    """Ray, connected to the cluster that RAY_ADDRESS names, or to a new one of so many cores, 0 for
    all."""
    try:
        import ray  # pyright: ignore[reportMissingImports]
    except ImportError:
        raise UserError("Ray is not installed; run pip install 'iswarm-mj[cluster]'") from None
    if not ray.is_initialized():
        local = (
            {}
            if os.environ.get("RAY_ADDRESS")
            else {"num_cpus": workers or None, "include_dashboard": False}
        )
        os.environ.setdefault(
            "RAY_USAGE_STATS_ENABLED", "0"
        )  # else it tells its makers, by the internet
        with kept_handlers(), warnings.catch_warnings():
            # JAX warns of each fork, but Ray's children start another program at once.
            warnings.simplefilter("ignore", RuntimeWarning)
            ray.init(logging_level=logging.ERROR, log_to_driver=False, **local)
    return ray


def _begin(parent: int) -> None:
    """Prepare a worker: interrupts are its parent's, with which it ends even if that is killed, and
    so are GPUs."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.environ["JAX_PLATFORMS"] = "cpu"
    process_executor._MAX_MEMORY_LEAK_SIZE = _MOST_GROWTH
    # While one worker writes a compiled program, another may read half of it; it compiles the
    # program itself then.
    warnings.filterwarnings("ignore", _HALF_WRITTEN, UserWarning)
    threading.Thread(target=_end_with, args=[parent], daemon=True).start()


def _end_with(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(1.0)
    os._exit(1)


def _lost() -> SimulationFault:
    return SimulationFault(
        "a worker process was lost, perhaps since there is too little memory; finished runs are "
        "kept: start the command again with fewer workers"
    )
