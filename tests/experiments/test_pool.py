"""Jobs in worker processes: nothing is lost or mixed up, whoever dies."""

import importlib.util
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

import jax
import numpy as np
import pytest

from iswarm_mj.experiments.runner import batches, pool
from iswarm_mj.experiments.runner.jobs import Job, Outcome, run_job
from iswarm_mj.experiments.runner.pool import each, map_jobs
from iswarm_mj.simulation.metrics import Measures
from iswarm_mj.strategy.genome import Genome
from iswarm_mj.utils.errors import SimulationFault, UserError


@pytest.fixture(scope="module")
def jobs(small):
    return [Job(small, Genome(), 30, seed, steps=steps) for seed, steps in enumerate((5, 40, 10, 20, 1, 30))]


@pytest.fixture(scope="module")
def expected(jobs):
    outcomes = [run_job(job) for job in jobs]
    assert len(set(outcomes)) == len(jobs)
    return outcomes


def workers_of(parent):
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


def fake(index, job):
    """An outcome without a run."""
    return index, Outcome(job.seed, 0, 0, None, None, job.steps, 0.0)


class TestProcesses:
    @pytest.mark.parametrize("workers", [1, 2])
    def test_outcomes_have_the_order_of_the_jobs(self, jobs, expected, workers):
        assert map_jobs(jobs, workers) == expected

    def test_workers_start_once(self, jobs, expected):
        map_jobs(jobs[:2], 2)
        before = workers_of(os.getpid())
        assert map_jobs(jobs, 2) == expected
        assert workers_of(os.getpid()) == before and len(before) == 2

    def test_long_jobs_begin_first(self, jobs, expected):
        finished = list(each(jobs, workers=1))
        assert [index for index, _ in finished] == [1, 5, 3, 2, 0, 4]
        assert all(outcome == expected[index] for index, outcome in finished)

    def test_no_jobs(self):
        assert map_jobs([], 2) == map_jobs([], 1) == []

    def test_the_jobs_of_a_lost_worker_are_done_again(self, jobs, expected):
        seen = {}
        with closing(each(jobs, 2)) as finished:
            for index, outcome in finished:
                assert index not in seen
                seen[index] = outcome
                if len(seen) == 1:
                    os.kill(workers_of(os.getpid())[0], signal.SIGKILL)
        assert [seen[index] for index in range(len(jobs))] == expected

    def test_workers_that_keep_dying_end_it(self, jobs, monkeypatch):
        def dies(index, job):
            os.kill(os.getpid(), signal.SIGKILL)

        monkeypatch.setattr(pool, "_work", dies)
        monkeypatch.setattr(pool, "MAX_LOSSES", 1)
        with pytest.raises(SimulationFault, match=r"died 2 times .* of 30 robots with seed 1; .* fewer --workers$"):
            map_jobs(jobs, 2)

    def test_a_worker_may_die_now_and_then(self, jobs, monkeypatch, tmp_path):
        """Each job kills its worker once, more often in all than is allowed in a row."""
        monkeypatch.setattr(pool, "MAX_LOSSES", 2)

        def dies_once(index, job):
            mark = tmp_path / str(index)
            if not mark.exists():
                mark.touch()
                os.kill(os.getpid(), signal.SIGKILL)
            return fake(index, job)

        monkeypatch.setattr(pool, "_work", dies_once)
        assert [outcome.delivered for outcome in map_jobs(jobs, 2)] == [job.seed for job in jobs]

    def test_a_fault_ends_it_and_the_next_call_works(self, jobs, expected, monkeypatch):
        def faulty(index, job):
            if index == 3:
                raise SimulationFault("step 8: gone")
            return fake(index, job)

        with monkeypatch.context() as patch:
            patch.setattr(pool, "_work", faulty)
            with pytest.raises(SimulationFault, match=r"^step 8: gone$"):
                map_jobs(jobs, 2)
        assert map_jobs(jobs, 2) == expected

    @pytest.mark.filterwarnings("error")
    def test_closing_it_early_stops_the_workers(self, jobs, expected):
        with closing(each(jobs, 2)) as finished:
            next(finished)
        assert map_jobs(jobs, 2) == expected


def test_programs_read_half_written_are_silent_in_workers(jobs, monkeypatch):
    """Nothing else is: neither other errors of the cache nor other warnings."""
    half = zlib.compress(bytes(1000))[:-8]
    with pytest.raises(zlib.error) as error:
        zlib.decompress(half)
    entry = "Error reading persistent compilation cache entry for 'jit_step'"
    told = [f"{entry}: error: {error.value}", f"{entry}: PermissionError: no", "truncated stream"]

    def warns(job):
        for text in told:
            warnings.warn(text, stacklevel=1)

    monkeypatch.setattr(pool, "run_job", warns)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        pool._work(0, jobs[0])
    assert [str(warning.message) for warning in caught] == told[1:]


SCRIPT = """
import sys
from iswarm_mj.config import ArenaConfig, SwarmConfig
from iswarm_mj.experiments.runner import pool
from iswarm_mj.experiments.runner.jobs import Job
from iswarm_mj.strategy.genome import Genome

small = SwarmConfig(arena=ArenaConfig(size=15, dump_size=3, dust_area_size=3, dust_area_offset=5, n_dust=24))
if __name__ == "__main__":
    try:
        for _ in pool.each([Job(small, Genome(), 30, seed, steps=100_000, stop_at=24) for seed in range(9999)], 2):
            print("one", flush=True)
    except KeyboardInterrupt:
        print("interrupted", flush=True)
        sys.exit(130)
"""


class TestEnds:
    @pytest.fixture
    def process(self, tmp_path):
        """A process with two workers that have finished their first run."""
        script = tmp_path / "many.py"
        script.write_text(SCRIPT)
        command = [sys.executable, str(script)]
        with subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True, cwd=tmp_path
        ) as process:
            assert process.stdout.readline() == "one\n"
            workers = workers_of(process.pid)
            assert len(workers) == 2
            yield process, workers
            process.kill()

    def gone(self, workers, seconds):
        end = time.monotonic() + seconds
        while any(Path(f"/proc/{w}").exists() for w in workers) and time.monotonic() < end:
            time.sleep(0.05)
        return not any(Path(f"/proc/{w}").exists() for w in workers)

    def test_an_interrupt_ends_quietly(self, process):
        process, workers = process
        os.killpg(process.pid, signal.SIGINT)  # as a terminal does, to the workers too
        out, error = process.communicate(timeout=20)
        assert process.returncode == 130 and out.endswith("interrupted\n")
        assert "Traceback" not in error and self.gone(workers, 5)

    def test_workers_end_with_a_parent_that_is_killed(self, process):
        process, workers = process
        process.kill()
        process.wait(timeout=20)
        assert self.gone(workers, 10)


@pytest.fixture(scope="module")
def ray():
    """Ray, if it is there, stopped in the end."""
    ray = pytest.importorskip("ray")
    yield ray
    ray.shutdown()


class TestRay:
    def test_its_absence_is_told_in_a_sentence(self, jobs, monkeypatch):
        monkeypatch.setitem(sys.modules, "ray", None)
        with pytest.raises(UserError, match=r"^--backend was ray, which is not installed; .*\[cluster\]'\.$"):
            map_jobs(jobs, backend="ray")

    def test_the_same_outcomes(self, ray, jobs, expected):
        assert map_jobs(jobs, 2, backend="ray") == expected

    def test_lost_workers_and_faults(self, ray, jobs, monkeypatch, tmp_path):
        def dies_once(index, job):
            mark = tmp_path / str(index)
            if not mark.exists():
                mark.touch()
                os.kill(os.getpid(), signal.SIGKILL)
            if index == 6:
                raise SimulationFault("step 8: gone")
            return index, Outcome(job.seed, 0, 0, None, None, job.steps, 0.0)

        monkeypatch.setattr(pool, "_work", dies_once)
        assert [outcome.delivered for outcome in map_jobs(jobs, 2, backend="ray")] == [job.seed for job in jobs]
        with pytest.raises(SimulationFault, match=r"^step 8: gone$"):
            map_jobs([*jobs, jobs[0]], 2, backend="ray")


class TestMjx:
    def test_other_engines_and_backends_are_refused(self, jobs):
        with pytest.raises(UserError, match=r"^engine must be mujoco or mjx \(got 'abacus'\)"):
            map_jobs(jobs, engine="abacus")
        with pytest.raises(UserError, match=r"^--backend was ray, whose workers do not run --engine mjx; "):
            map_jobs(jobs, engine="mjx", backend="ray")

    def test_no_jobs(self):
        assert map_jobs([], engine="mjx") == []

    @pytest.mark.parametrize(
        "device, has_warp, expected",
        [
            (("cpu", "cpu"), True, "jax"),
            (("gpu", "NVIDIA H100 80GB HBM3"), True, "warp"),
            (("gpu", "NVIDIA H100 80GB HBM3"), False, "jax"),
            (("gpu", "AMD Instinct MI300X"), True, "jax"),
            (("tpu", "TPU v4"), True, "jax"),
        ],
    )
    def test_warp_where_it_runs(self, monkeypatch, device, has_warp, expected):
        with monkeypatch.context() as patch:
            patch.setattr(jax, "devices", lambda: [SimpleNamespace(platform=device[0], device_kind=device[1])])
            patch.setattr(importlib.util, "find_spec", lambda name: (has_warp and name == "warp") or None)
            assert batches.implementation() == expected

    @pytest.fixture
    def tried(self, monkeypatch):
        """A stand-in for batches, which needs 2.5 times the rule's room, and the room of those that were begun."""
        rooms = []

        class Crowded:
            is_over, needed, bit = False, 2.5, 1

            def __init__(self, config, worlds, settings):
                rooms.append(settings.contact_room)
                self.lacks, self.sizes = settings.contact_room < self.needed, [w.n_robots for w in worlds]

            def advance(self):
                self.is_over = True
                if self.lacks:
                    raise SimulationFault("step 3, world 0: no room")

            def arrays(self):
                bits = np.array([0, 0, self.bit if self.lacks else 0])
                return None, SimpleNamespace(fault=SimpleNamespace(bits=bits))

            def measures(self, world):
                return Measures(self.sizes[world], 0, 0, None, None)

        monkeypatch.setattr(batches, "BatchRun", Crowded)
        return Crowded, rooms

    @pytest.mark.parametrize("impl, expected", [("jax", [1, 2, 4]), ("warp", [4])])
    def test_a_crowded_batch_gets_more_room(self, jobs, monkeypatch, tried, impl, expected):
        monkeypatch.setattr(batches, "implementation", lambda: impl)
        assert [outcome.delivered for outcome in map_jobs(jobs[:1], engine="mjx")] == [30]
        assert tried[1] == expected

    @pytest.mark.parametrize("needed, bit, expected", [(9, 2, [1, 2, 4, 8]), (9, 4, [1])])
    def test_what_more_room_does_not_mend_is_a_fault(self, jobs, tried, needed, bit, expected):
        tried[0].needed, tried[0].bit = needed, bit
        with pytest.raises(SimulationFault, match="no room"):
            map_jobs(jobs[:1], engine="mjx")
        assert tried[1] == expected

    def test_batches_of_other_sizes_have_the_same_places(self, small):
        def sizes(*n_robots):
            return [w.n_robots for w in batches._worlds([Job(small, Genome(), n, 0) for n in n_robots])]

        assert sizes(30, 30) == [30, 30]
        assert sizes(30, 20) == [30, 20, 64] and sizes(64, 50) == [64, 50, 64] and sizes(65, 50) == [65, 50, 128]
        assert sizes(216, 50) == [216, 50, 216]  # there are no more cells
        assert batches._worlds([Job(small, Genome(), n, 0) for n in (30, 20)])[-1].failed_fraction == 1


@pytest.mark.slow
def test_worlds_of_a_batch_are_the_jobs(small):
    """MJX runs jobs of two lengths and of different numbers of robots as two batches; over a few steps as MuJoCo C."""
    given = [(12, 1, 20), (10, 2, 20), (12, 3, 10)]
    jobs = [Job(small, Genome(), n_robots, seed, steps=steps) for n_robots, seed, steps in given]
    batched, alone = map_jobs(jobs, engine="mjx"), map_jobs(jobs, 1)
    assert [(o.delivered, o.picked, o.steps) for o in batched] == [(o.delivered, o.picked, o.steps) for o in alone]
    assert sum(o.picked for o in alone) > 3
