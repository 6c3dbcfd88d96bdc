"""Jobs in worker processes: nothing is lost or mixed up, whoever dies."""

import os
import signal
import subprocess
import sys
import time
import warnings
import zlib
from contextlib import closing
from pathlib import Path
from types import SimpleNamespace

import pytest
from helpers_jobs import TWO, jobs_of, outcomes_of
from joblib.externals.loky.process_executor import _ExecutorManagerThread

from iswarm_mj.experiments.runner import worker
from iswarm_mj.experiments.runner.jobs import run_job
from iswarm_mj.experiments.runner.pool import Execution, run_jobs
from iswarm_mj.utils.errors import SimulationFault, UserError

LIMIT = 600
"""Longest time for something that has to happen [s]."""


@pytest.fixture(scope="module")
def jobs(small):
    return jobs_of(small)


@pytest.fixture(scope="module")
def expected(jobs):
    outcomes = [run_job(job) for job in jobs]
    assert len(set(outcomes)) == len(jobs)
    return outcomes


@pytest.fixture
def stubs(monkeypatch):
    """Jobs whose outcome is their seed, so that workers need not load the simulation."""
    monkeypatch.setattr(worker, "work", lambda index, job, engine: (index, job.seed))
    return [SimpleNamespace(n_robots=30, seed=seed, steps=steps) for seed, steps in enumerate((5, 40, 10, 20, 1, 30))]


SEEDS = [0, 1, 2, 3, 4, 5]
"""Outcomes of the stubs."""


def dying_once(directory):
    """A worker's code that is killed by each job's first attempt, and fails for good at a seventh job."""

    def work(index, job, engine):
        mark = directory / str(index)
        if index == 6:
            raise SimulationFault("step 8: gone")
        if not mark.exists():
            mark.touch()
            os.kill(os.getpid(), signal.SIGKILL)
        return index, job.seed

    return work


def children_of(parent):
    """Process ids of the loky workers of a process."""
    found = []
    for path in Path("/proc").glob("[0-9]*"):
        try:
            if b"popen_loky" in (path / "cmdline").read_bytes():
                status = (path / "stat").read_text().rpartition(")")[2].split()
                if int(status[1]) == parent and status[0] != "Z":
                    found.append(int(path.name))
        except OSError:
            pass
    return sorted(found)


class TestProcesses:
    @pytest.mark.parametrize("workers", [1, 2])
    def test_outcomes_are_those_of_the_jobs_by_themselves(self, jobs, expected, workers):
        assert outcomes_of(jobs, Execution(workers=workers)) == expected

    def test_workers_start_once(self, stubs):
        outcomes_of(stubs[:2])
        before = children_of(os.getpid())
        assert outcomes_of(stubs) == SEEDS
        assert children_of(os.getpid()) == before and len(before) == 2

    def test_long_jobs_begin_first(self, jobs, expected):
        finished = list(run_jobs(jobs, Execution(workers=1)))
        assert [index for index, _ in finished] == [1, 5, 3, 2, 0, 4]
        assert all(outcome == expected[index] for index, outcome in finished)

    def test_no_jobs(self):
        assert outcomes_of([]) == outcomes_of([], Execution(workers=1)) == []

    def test_the_jobs_of_a_lost_worker_are_repeated(self, stubs, monkeypatch, tmp_path):
        """A worker is killed while both are within a job."""
        killed, seen = tmp_path / "killed", {}

        def work(index, job, engine):
            while index != 1 and not killed.exists():
                time.sleep(0.01)
            return index, job.seed

        monkeypatch.setattr(worker, "work", work)
        with closing(run_jobs(stubs, TWO)) as finished:
            for index, outcome in finished:
                assert index not in seen
                seen[index] = outcome
                if len(seen) == 1:
                    os.kill(children_of(os.getpid())[0], signal.SIGKILL)
                    killed.touch()
        assert [seen[index] for index in range(len(stubs))] == SEEDS

    def test_workers_that_keep_dying_end_it(self, stubs, monkeypatch):
        monkeypatch.setattr(worker, "work", lambda index, job, engine: os.kill(os.getpid(), signal.SIGKILL))
        monkeypatch.setattr(worker, "MAX_LOSSES", 1)
        with pytest.raises(SimulationFault, match=r"died 2 times .* of 30 robots with seed 1; .* fewer `workers`$"):
            outcomes_of(stubs)

    def test_a_worker_may_die_now_and_then(self, stubs, monkeypatch, tmp_path):
        """Each job kills its worker once, more often in total than is allowed in a row."""
        monkeypatch.setattr(worker, "MAX_LOSSES", 2)
        monkeypatch.setattr(worker, "work", dying_once(tmp_path))
        assert outcomes_of(stubs) == SEEDS

    def test_a_fault_ends_it_and_the_next_call_works(self, stubs, monkeypatch):
        def faulty(index, job, engine):
            if index == 3:
                raise SimulationFault("step 8: gone")
            if index not in (1, 5):  # which begin before it
                time.sleep(LIMIT)
            return index, job.seed

        with monkeypatch.context() as patch:
            patch.setattr(worker, "work", faulty)
            with pytest.raises(SimulationFault, match=r"^step 8: gone$"):
                outcomes_of(stubs)
        assert outcomes_of(stubs) == SEEDS

    @pytest.mark.filterwarnings("error")
    def test_closing_it_early_stops_the_workers(self, stubs, monkeypatch):
        def slow(index, job, engine):
            if index != 1:
                time.sleep(LIMIT)
            return index, job.seed

        with monkeypatch.context() as patch:
            patch.setattr(worker, "work", slow)
            with closing(run_jobs(stubs, TWO)) as finished:
                assert next(finished) == (1, 1)
        assert outcomes_of(stubs) == SEEDS

    @pytest.mark.filterwarnings("error")
    def test_closing_it_while_a_job_is_handed_over_is_silent(self, stubs, monkeypatch):
        stop = _ExecutorManagerThread.flag_executor_shutting_down

        def stop_with_a_job(self):
            self.work_ids_queue.put(-1)
            stop(self)

        monkeypatch.setattr(_ExecutorManagerThread, "flag_executor_shutting_down", stop_with_a_job)
        with closing(run_jobs(stubs, TWO)) as finished:
            next(finished)


def test_programs_read_half_written_are_silent_in_workers(monkeypatch):
    """Nothing else is: neither other errors of the cache nor other warnings."""
    half = zlib.compress(bytes(1000))[:-8]
    with pytest.raises(zlib.error) as error:
        zlib.decompress(half)
    entry = "Error reading persistent compilation cache entry for 'jit_step'"
    told = [f"{entry}: error: {error.value}", f"{entry}: PermissionError: no", "truncated stream"]

    def warns(job, engine):
        for text in told:
            warnings.warn(text, stacklevel=1)

    monkeypatch.setattr("iswarm_mj.experiments.runner.jobs.run_job", warns)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        worker.work(0, None, "mujoco")
    assert [str(warning.message) for warning in caught] == told[1:]


def test_workers_load_the_simulation_with_the_first_job_only():
    code = "import sys, iswarm_mj.experiments.runner.worker; print({'jax', 'mujoco', 'numpy'} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=LIMIT)
    assert done.stdout == "set()\n"


SCRIPT = """
import os, sys, time
from types import SimpleNamespace
from iswarm_mj.experiments.runner import pool, worker

def work(index, job, engine):
    if "HAS_WORKED" in os.environ:  # so that the end comes within jobs
        time.sleep(600)
    os.environ["HAS_WORKED"] = "1"
    return index, os.getpid()

if __name__ == "__main__":
    worker.work = work
    jobs = [SimpleNamespace(n_robots=30, seed=seed, steps=1) for seed in range(99)]
    workers = set()
    try:
        for _, pid in pool.run_jobs(jobs, pool.Execution(workers=2)):
            if pid not in workers:
                print("one more", flush=True)
            workers.add(pid)
    except KeyboardInterrupt:
        print("interrupted", flush=True)
        sys.exit(130)
"""


class TestEnds:
    @pytest.fixture
    def process(self, tmp_path):
        """A process with two workers that have both finished a job."""
        script = tmp_path / "many.py"
        script.write_text(SCRIPT)
        command = [sys.executable, str(script)]
        with subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True, cwd=tmp_path
        ) as process:
            assert [process.stdout.readline() for _ in range(2)] == ["one more\n"] * 2
            workers = children_of(process.pid)
            assert len(workers) == 2
            yield process, workers
            process.kill()

    def wait_for_the_end_of(self, workers):
        end = time.monotonic() + LIMIT
        while any(Path(f"/proc/{worker}").exists() for worker in workers):
            assert time.monotonic() < end
            time.sleep(0.05)

    def test_an_interrupt_ends_quietly(self, process):
        process, workers = process
        os.killpg(process.pid, signal.SIGINT)  # as a terminal does, to the workers too
        out, error = process.communicate(timeout=LIMIT)
        assert process.returncode == 130 and out.endswith("interrupted\n")
        assert "Traceback" not in error
        self.wait_for_the_end_of(workers)

    def test_workers_end_with_a_parent_that_is_killed(self, process):
        process, workers = process
        process.kill()
        process.wait(timeout=LIMIT)
        self.wait_for_the_end_of(workers)


@pytest.fixture(scope="module")
def ray():
    """Ray, if it is there, stopped in the end."""
    ray = pytest.importorskip("ray")
    yield ray
    ray.shutdown()


class TestRay:
    RAY = Execution(workers=2, backend="ray")

    def test_a_sentence_names_what_is_missing(self, stubs, monkeypatch):
        monkeypatch.setitem(sys.modules, "ray", None)
        with pytest.raises(UserError, match=r"^`backend` ray needs Ray; .*\[cluster\]'$"):
            outcomes_of(stubs, self.RAY)

    def test_the_same_outcomes(self, ray, jobs, expected):
        assert outcomes_of(jobs, self.RAY) == expected

    def test_lost_workers_and_faults(self, ray, stubs, monkeypatch, tmp_path):
        monkeypatch.setattr(worker, "work", dying_once(tmp_path))
        assert outcomes_of(stubs, self.RAY) == SEEDS
        with pytest.raises(SimulationFault, match=r"^step 8: gone$"):
            outcomes_of([*stubs, stubs[0]], self.RAY)
