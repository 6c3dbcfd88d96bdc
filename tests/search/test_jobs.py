"""Jobs: the run of one world each, by hand, in workers, and as worlds of batches."""

from contextlib import closing
from typing import ClassVar

import pytest

from iswarm_mj.engines.mjx.settings import MjxSettings
from iswarm_mj.engines.mujoco.settings import MujocoSettings
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.search import pool
from iswarm_mj.search.pool import Execution, Job, outcomes, run_batches, run_jobs
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.scenario import Scenario
from iswarm_mj.simulation.worlds import World
from iswarm_mj.strategy.genome import PRESETS, Genome
from iswarm_mj.tasks.measures import Measures
from iswarm_mj.utils.errors import ConfigError, FaultKind, SimulationFault

GENOME = PRESETS["type2"]
MUJOCO = MujocoSettings()
MJX = Execution(MjxSettings())


def run_job(job, engine=MUJOCO):
    """Return the outcome of one job."""
    return outcomes([job], engine)[0]


def outcomes_of(jobs, execution):
    """Return outcomes in the order of the jobs; each comes once."""
    with closing(run_jobs(jobs, execution)) as finished:
        numbered = list(finished)
    assert sorted(index for index, _ in numbered) == list(range(len(jobs)))
    return [outcome for _, outcome in sorted(numbered, key=lambda pair: pair[0])]


def test_a_job_is_the_run_by_hand(small):
    job = Job(small, GENOME, n_robots=30, seed=5, steps=25, failed_fraction=0.2)
    outcome = run_job(job)

    world = World(GENOME, 30, seed=5, failed_fraction=0.2)
    run = Run(Scenario(small, strategy=GENOME, worlds=[world], steps=25))
    for _ in range(25):
        run.advance()
    assert outcome.items() >= run.measures(0)._asdict().items()
    assert outcome["steps"] == 25

    assert outcome["collisions"] > 0
    assert outcome["picked"] > outcome["delivered"]
    balls = outcome["picked"] + outcome["delivered"]
    points = 20 * balls - 0.05 / 30 * outcome["collisions"]
    assert outcome["fitness"] == pytest.approx(points, abs=1e-9)


def test_steps_that_are_left_count_when_all_balls_are_delivered(small):
    outcome = run_job(Job(small, PRESETS["type1"], 30, seed=0, steps=500))
    assert outcome["delivered"] == 24
    assert outcome["finished_at"] == outcome["steps"] < 500
    steps_left = 500 - outcome["steps"]
    points = 40 * 24 - 0.05 / 30 * outcome["collisions"] + 10 * steps_left
    assert outcome["fitness"] == pytest.approx(points, abs=1e-9)

    stopped = run_job(Job(small, PRESETS["type1"], 30, seed=0, steps=500, stop_at=5))
    assert 5 <= stopped["delivered"] < 24
    assert stopped["finished_at"] == stopped["steps"] < outcome["steps"]
    assert stopped["fitness"] <= 20 * (stopped["delivered"] + stopped["picked"])


def test_long_jobs_begin_first(small, monkeypatch):
    steps_of_jobs = (5, 40, 10, 20, 1, 30)
    jobs = []
    for seed, steps in enumerate(steps_of_jobs):
        jobs.append(Job(small, Genome(), 30, seed, steps=steps))
    monkeypatch.setattr(pool, "outcomes", lambda jobs, _: [{"seed": job.seed} for job in jobs])
    finished = list(run_jobs(jobs, Execution(workers=1)))
    assert finished == [(index, {"seed": index}) for index in (1, 5, 3, 2, 0, 4)]


@pytest.fixture
def pretended(monkeypatch):
    """Return a stand-in for `Run`, which notes the places for robots of each run."""

    class PretendedRun:
        capacities: ClassVar = []
        fault_of_last = 0
        """Kind of a fault of the last world; 0 for none."""
        finished_at: ClassVar = {}
        """Steps in which worlds finish, by their numbers."""

        def __init__(self, scenario, *, record_worlds, capacity):
            self.capacities.append(capacity)
            self.n_robots = [world.n_robots for world in scenario.worlds]
            self.is_over = False

        def advance(self):
            self.is_over = True

        @property
        def fault_of_each(self):
            faults = [None] * len(self.n_robots)
            if self.fault_of_last:
                faults[-1] = SimulationFault(step=3, world=0, kind=self.fault_of_last)
            return faults

        def measures(self, world):
            return Measures(self.n_robots[world], 0, 0, None, self.finished_at.get(world))

    monkeypatch.setattr(pool, "Run", PretendedRun)
    return PretendedRun


def test_a_fault_names_its_job(small, pretended):
    pretended.fault_of_last = FaultKind.TOO_MANY_CONTACTS
    jobs = [Job(small, Genome(), 30, seed) for seed in (0, 77)]
    message = r"^run of 30 robots with seed 77: step 3, world 0: .*contact_capacity"
    with pytest.raises(SimulationFault, match=message):
        outcomes_of(jobs, MJX)


class TestBatches:
    """Jobs that share everything that worlds of one run must share."""

    @pytest.mark.parametrize(
        ("sizes", "capacity"),
        [((30, 30), 30), ((64, 50), 64), ((65, 50), 128), ((216, 50), 216)],
    )
    def test_batches_of_similar_sizes_share_a_program(self, small, pretended, sizes, capacity):
        """A program is for arrays of one size; the arena has 216 cells for robots."""
        pretended.finished_at = {0: 13}
        jobs = [Job(small, Genome(), n_robots, seed=0, steps=20) for n_robots in sizes]
        first, second = outcomes_of(jobs, MJX)
        assert pretended.capacities == [capacity]
        assert (first["delivered"], second["delivered"]) == sizes
        assert (first["steps"], second["steps"]) == (13, 20)

    @pytest.mark.parametrize(
        ("max_worlds", "sizes"), [(384, [384]), (200, [192, 192]), (1, [1] * 384)]
    )
    def test_batches_fit_into_the_memory(self, small, monkeypatch, max_worlds, sizes):
        """The memory is asked for room for as many robots as the largest job has."""
        asked = []
        run = []

        def limit(engine, n_robots):
            asked.append(n_robots)
            return max_worlds

        def run_batch(jobs, engine):
            run.append(len(jobs))
            return [{"seed": job.seed} for job in jobs]

        monkeypatch.setattr(pool, "max_worlds", limit)
        monkeypatch.setattr(pool, "outcomes", run_batch)
        jobs = []
        for seed in range(384):
            jobs.append(Job(small, Genome(), n_robots=(100, 216, 150)[seed % 3], seed=seed))
        finished = list(run_batches(jobs, PlanarSettings(1, impl="warp")))
        assert asked == [216]
        assert run == sizes
        assert finished == [(seed, {"seed": seed}) for seed in range(384)]

    def test_jobs_end_as_they_do_alone(self, small, monkeypatch):
        """Jobs of two lengths, one with dead robots, are two batches."""
        jobs = [
            Job(small, Genome(), 12, seed=1, steps=20),
            Job(small, Genome(), 12, seed=2, steps=20, failed_fraction=0.5),
            Job(small, Genome(), 12, seed=3, steps=10),
        ]
        n_worlds = []

        def run(scenario, **options):
            n_worlds.append(scenario.n_worlds)
            return Run(scenario, **options)

        monkeypatch.setattr(pool, "Run", run)
        batched = [outcome for _, outcome in run_batches(jobs, PlanarSettings(1))]
        assert n_worlds == [2, 1]
        assert batched == [run_job(job, PlanarSettings(1)) for job in jobs]
        assert sum(outcome["picked"] for outcome in batched) > 3

    def test_planar_is_run_in_batches_where_there_is_a_gpu(self, monkeypatch):
        settings = {"engine": "planar", "refinement": 2, "accuracy": 0.1}
        without_gpu = Execution(PlanarSettings.usual())
        assert not without_gpu.in_batches
        assert without_gpu.identity == settings
        assert without_gpu.settings == PlanarSettings(1)

        monkeypatch.setattr("iswarm_mj.engines.settings.can_use_warp", lambda: True)
        with_gpu = Execution(PlanarSettings.usual())
        assert with_gpu.in_batches
        assert with_gpu.identity == settings | {"impl": "warp"}
        assert Execution(MjxSettings.usual()).settings == MjxSettings("warp", contact_capacity=4.0)

        message = "backend must be processes with `engine` planar and `impl` warp"
        with pytest.raises(ConfigError, match=message):
            Execution(PlanarSettings.usual(), backend="ray")
