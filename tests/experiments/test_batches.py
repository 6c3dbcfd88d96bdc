"""Jobs as worlds of batches: each is measured as it is alone."""

from dataclasses import replace
from types import SimpleNamespace

import pytest
from helpers_jobs import jobs_of, outcomes_of

from iswarm_mj.engines.mjx.settings import MjxSettings
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.experiments.runner import batches
from iswarm_mj.experiments.runner import jobs as jobs_module
from iswarm_mj.experiments.runner.jobs import Job, run_job
from iswarm_mj.experiments.runner.pool import Execution
from iswarm_mj.simulation import memory_check
from iswarm_mj.simulation.run import Run
from iswarm_mj.strategy.genome import Genome
from iswarm_mj.tasks.measures import Measures
from iswarm_mj.utils.errors import ConfigError, FaultKind, SimulationFault

MJX = Execution(MjxSettings())


@pytest.fixture(scope="module")
def jobs(small):
    return jobs_of(small)


@pytest.fixture
def tried(monkeypatch):
    """A stand-in for runs, and how many places for robots those begun have."""
    begun = []

    class Crowded:
        is_over, kind = False, 0

        def __init__(self, config, genome, settings, engine, worlds):
            begun.append(settings.capacity)
            self.sizes = [world.n_robots for world in worlds]

        def advance(self):
            self.is_over = True

        @property
        def fault_of_each(self):
            """The last world has one."""
            fault = SimulationFault(step=3, world=0, kind=self.kind) if self.kind else None
            return [*[None] * (len(self.sizes) - 1), fault]

        def measures(self, world):
            return Measures(self.sizes[world], 0, 0, None, None)

    monkeypatch.setattr(jobs_module, "Run", Crowded)
    return Crowded, begun


def test_a_fault_names_its_job(jobs, tried):
    tried[0].kind = FaultKind.TOO_MANY_CONTACTS
    with pytest.raises(SimulationFault, match=r"^run of 30 robots with seed 77: step 3, world 0: .*contact_capacity"):
        outcomes_of([jobs[0], replace(jobs[0], seed=77)], MJX)


@pytest.mark.parametrize(
    "sizes, capacity",
    [((30, 30), 30), ((30, 20), 64), ((20, 30), 64), ((64, 50), 64), ((65, 50), 128), ((216, 50), 216)],
)
def test_batches_of_other_sizes_share_a_program(small, tried, sizes, capacity):
    """A program is for arrays of one size; the arena has 216 cells for robots."""
    found = outcomes_of([Job(small, Genome(), n_robots, 0) for n_robots in sizes], MJX)
    assert [outcome.measures.delivered for outcome in found] == list(sizes) and tried[1] == [capacity]


@pytest.mark.parametrize(
    "fitting, sizes", [(None, [384]), (384, [384]), (200, [192, 192]), (100, [96] * 4), (0, [1] * 384)]
)
def test_batches_of_planar_fit_into_the_memory(monkeypatch, fitting, sizes):
    """Of any sizes, with half of what is free left for what is not estimated."""
    jobs, planar = [SimpleNamespace(n_robots=n) for n in [100, 950, 240] * 128], PlanarSettings(1, impl="warp")
    free = fitting and int(2 * fitting * memory_check.needed_memory(planar, 1, 950))
    monkeypatch.setattr(memory_check, "_free_memory", lambda _: free)
    parts = batches._parts(range(len(jobs)), jobs, planar)
    assert [len(part) for part in parts] == sizes
    assert [index for part in parts for index in part] == list(range(384))


class TestPlanarInBatches:
    def test_where_there_is_a_gpu(self, monkeypatch):
        without = Execution(PlanarSettings.usual())
        settings = {"engine": "planar", "refinement": 1, "accuracy": 0.01}
        assert not without.in_batches and without.identity == settings and without.settings == PlanarSettings(1)
        monkeypatch.setattr("iswarm_mj.engines.settings.can_use_warp", lambda: True)
        with_gpu = Execution(PlanarSettings.usual())
        assert with_gpu.in_batches and with_gpu.identity == settings | {"impl": "warp"}
        assert Execution(MjxSettings.usual()).settings == MjxSettings("warp", contact_capacity=4.0)
        with pytest.raises(ConfigError, match="backend must be processes with `engine` planar and `impl` warp"):
            Execution(PlanarSettings.usual(), backend="ray")
        assert not Execution().in_batches

    def test_a_job_that_finishes_early_took_so_many_steps(self, small, tried, monkeypatch):
        """The other of the batch took all."""
        measures = [Measures(24, 24, 0, 5.0, 13), Measures(3, 4, 0, 5.0, None)]
        monkeypatch.setattr(tried[0], "measures", lambda _, world: measures[world])
        jobs = [Job(small, Genome(), 12, seed, steps=20) for seed in range(2)]
        found = dict(batches.run_batches(jobs, PlanarSettings()))
        assert [found[index].steps for index in range(2)] == [13, 20]

    def test_jobs_end_as_alone(self, small, monkeypatch):
        """Jobs of two lengths, one with dead robots, as two batches."""
        given = [(1, 20, 0.0), (2, 20, 0.5), (3, 10, 0.0)]
        jobs = [Job(small, Genome(), 12, seed, steps=steps, failed_fraction=dead) for seed, steps, dead in given]
        begun = []

        def run(*arguments, **parts):
            begun.append(len(parts["worlds"]))
            return Run(*arguments, **parts)

        monkeypatch.setattr(jobs_module, "Run", run)
        batched = outcomes_of(jobs, Execution(PlanarSettings(impl="warp")))
        assert begun == [2, 1]
        assert batched == [run_job(job, PlanarSettings(impl="warp")) for job in jobs]
        assert sum(o.measures.picked for o in batched) > 3
