"""Jobs on all cores of a machine, or on a cluster: the same outcomes in any number of processes."""

import logging
import os
import signal
import sys
import threading
import time
import warnings
from collections.abc import Generator, Sequence
from contextlib import closing, contextmanager
from typing import Any, cast

import jax
from joblib import Parallel, cpu_count, delayed
from joblib.externals.loky.process_executor import BrokenProcessPool
from tqdm import tqdm

from iswarm_mj.experiments.runner.jobs import Job, Outcome, run_job
from iswarm_mj.utils.constraints import check
from iswarm_mj.utils.errors import SimulationFault, UserError

BACKENDS = ("processes", "ray")
ENGINES = ("mujoco", "mjx")
MAX_LOSSES = 3
"""So many times in a row, workers may die before another job is finished."""

_HALF_WRITTEN = r"Error reading persistent compilation cache entry for .*truncated stream"

Finished = Generator[tuple[int, Outcome], None, None]


def map_jobs(
    jobs: Sequence[Job], workers: int = 0, engine: str = "mujoco", backend: str = "processes", describe: str = ""
) -> list[Outcome]:
    """Outcomes of the jobs, in their order, with progress on a terminal.

    Arguments and errors as for `each`; `describe` stands before the progress bar.
    """
    outcomes: dict[int, Outcome] = {}
    with progress(len(jobs), describe) as bar, closing(each(jobs, workers, engine, backend)) as finished:
        for index, found in finished:
            outcomes[index] = found
            bar.update()
    return [outcomes[index] for index in range(len(jobs))]


def each(jobs: Sequence[Job], workers: int = 0, engine: str = "mujoco", backend: str = "processes") -> Finished:
    """Yield (index of the job, outcome) as the jobs are finished; the long ones are begun first.

    Workers start with the first call and serve later ones too. The jobs of a worker that was lost are done again.
    Leaving the iterator early, by an exception or by closing it, stops the workers.

    Args:
        jobs: what to run.
        workers: processes, 0 for one a core of this machine (of the cluster, with Ray); 1 is this process itself.
        engine: physics; mujoco, or mjx, where all jobs of equal settings are one batch of worlds in this process,
            whatever `workers` says; see `batches.run_batches`.
        backend: processes (of this machine) or ray (a cluster, where RAY_ADDRESS names one).

    Raises:
        SimulationFault: a run could not go on, or workers keep dying.
        UserError: Ray is not installed, or a job is not possible.
    """
    check_engine(engine, backend)
    if engine == "mjx":
        from iswarm_mj.experiments.runner.batches import run_batches

        return run_batches(jobs)
    numbered = sorted(enumerate(jobs), key=lambda item: -item[1].n_robots * item[1].steps)
    if backend == "ray":
        return _on_ray(numbered, workers)
    workers = workers or cpu_count()
    if workers == 1:
        return ((index, run_job(job)) for index, job in numbered)
    return _on_processes(numbered, workers)


def check_engine(engine: str, backend: str) -> None:
    """Raise a UserError unless there is such an engine, and it goes with the backend."""
    check("engine", engine, " or ".join(ENGINES), engine in ENGINES)
    if engine == "mjx" and backend != "processes":
        raise UserError(f"--backend was {backend}, whose workers do not run --engine mjx; leave one of the two out.")


def identity(engine: str) -> dict[str, str]:
    """What settings tell of an engine that decides an outcome; nothing of the default one."""
    if engine == "mujoco":
        return {}
    from iswarm_mj.experiments.runner.batches import implementation

    return {"engine": engine, "impl": implementation()}


def progress(total: int, describe: str = "", done: int = 0) -> tqdm:
    """Bar with the remaining time, on a terminal only: `total` runs, of which `done` are there already."""
    return tqdm(total=total, initial=done, desc=describe or None, unit="run", disable=not sys.stderr.isatty())


def _work(index: int, job: Job) -> tuple[int, Outcome]:
    """Run a job in a worker, which leaves interrupts to its parent and GPUs alone."""
    # Workers that compile a program at the same time may read it half written; it is compiled anew then.
    warnings.filterwarnings("ignore", _HALF_WRITTEN, UserWarning)
    jax.config.update("jax_platforms", "cpu")
    return index, run_job(job)


def _start_worker(parent: int) -> None:
    """Leave interrupts to the parent, and end with it even where it is killed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with, args=[parent], daemon=True).start()


def _end_with(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(1.0)
    os._exit(1)


def _on_processes(numbered: Sequence[tuple[int, Job]], workers: int) -> Finished:
    """Jobs on worker processes of this machine."""
    # A worker that has grown by 300 MB, by programs for many numbers of robots, is replaced between two jobs.
    warnings.filterwarnings("ignore", "A worker stopped while some jobs were given", UserWarning)
    left, losses = dict(numbered), 0
    while left:
        pool: Any = Parallel(
            workers, "loky", "generator_unordered", batch_size=cast(Any, 1), initializer=_start_worker,
            initargs=(os.getpid(),),
        )  # fmt: skip
        try:
            with _stopped(pool(delayed(_work)(*item) for item in list(left.items()))) as finished:
                for index, found in finished:
                    del left[index]
                    losses = 0
                    yield index, found
        except BrokenProcessPool:
            losses += 1
            if losses > MAX_LOSSES:
                raise SimulationFault(_lost(losses, left)) from None


@contextmanager
def _stopped(finished: Finished) -> Generator[Finished, None, None]:
    """Close an iterator at the end, without joblib's warning that not all of it was wanted."""
    try:
        yield finished
    finally:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)
            finished.close()


def _lost(times: int, left: dict[int, Job]) -> str:
    job = next(iter(left.values()))
    return (
        f"worker processes died {times} times without finishing a run, the first of them of {job.n_robots} robots "
        f"with seed {job.seed}; there may be too little memory: give fewer --workers"
    )


def _on_ray(numbered: Sequence[tuple[int, Job]], workers: int) -> Finished:
    """Jobs on a Ray cluster, or on one that is started here; Ray itself does the jobs of lost workers again."""
    ray = _started_ray(workers)
    remote = ray.remote(num_cpus=1, max_retries=MAX_LOSSES)(_work)
    waiting, running = list(reversed(numbered)), []
    try:
        while waiting or running:
            while waiting and (not workers or len(running) < workers):
                running.append(remote.remote(*waiting.pop()))
            (done, *_), running = ray.wait(running)
            yield ray.get(done)
    except ray.exceptions.RayTaskError as error:
        raise error.cause from None
    except ray.exceptions.WorkerCrashedError:
        raise SimulationFault(_lost(MAX_LOSSES + 1, dict(numbered))) from None
    finally:
        for task in running:
            ray.cancel(task, force=True)


def _started_ray(workers: int) -> Any:
    """Ray, connected to the cluster that RAY_ADDRESS names or to one on this machine."""
    try:
        import ray  # pyright: ignore[reportMissingImports]
    except ImportError:
        raise UserError(
            "--backend was ray, which is not installed; install it by pip install 'iswarm-mj[cluster]'."
        ) from None
    if not ray.is_initialized():
        local = {} if os.environ.get("RAY_ADDRESS") else {"num_cpus": workers or None, "include_dashboard": False}
        with warnings.catch_warnings():  # JAX warns of each fork; Ray's is followed by another program at once
            warnings.simplefilter("ignore", RuntimeWarning)
            ray.init(logging_level=logging.ERROR, log_to_driver=False, **local)
    return ray
