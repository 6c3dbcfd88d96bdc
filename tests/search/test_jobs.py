"""One world as a job: the run by hand, its measures and its fitness; jobs in workers, and as worlds
of batches."""

from contextlib import closing
from types import SimpleNamespace

import pytest

from iswarm_mj.engines.mjx.settings import MjxSettings
from iswarm_mj.engines.mujoco.settings import MujocoSettings
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.search import pool
from iswarm_mj.search.pool import Execution, Job, outcomes, run_jobs
from iswarm_mj.simulation import memory_limits
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.scenario import Scenario
from iswarm_mj.simulation.worlds import World
from iswarm_mj.strategy.genome import PRESETS, Genome
from iswarm_mj.tasks.measures import Measures
from iswarm_mj.utils.errors import ConfigError, FaultKind, SimulationFault

GENOME, MUJOCO, MJX = PRESETS["type2"], MujocoSettings(), Execution(MjxSettings())


def run_job(job, engine=MUJOCO):
    return outcomes([job], engine)[0]


def outcomes_of(jobs, execution):
    """Outcomes in the order of the jobs; none comes twice."""
    with closing(run_jobs(jobs, execution)) as finished:
        found = list(finished)
    assert sorted(index for index, _ in found) == list(range(len(jobs)))
    return [outcome for _, outcome in sorted(found, key=lambda item: item[0])]


def test_a_job_is_the_run_by_hand(small):
    found = run_job(Job(small, GENOME, n_robots=30, seed=5, steps=25, failed_fraction=0.2))
    world = World(GENOME, 30, seed=5, failed_fraction=0.2)
    run = Run(Scenario(small, strategy=GENOME, worlds=[world], steps=25))
    for _ in range(25):
        run.advance()
    assert found.items() >= run.measures(0)._asdict().items() and found["steps"] == 25
    assert found["collisions"] > 0 and found["picked"] > found["delivered"]
    points = 20 * (found["picked"] + found["delivered"]) - 0.05 / 30 * found["collisions"]
    assert found["fitness"] == pytest.approx(points, abs=1e-9)


def test_a_job_ends_when_it_is_finished(small):
    """What is left of the job's steps counts, but only where all balls are delivered."""
    clean = run_job(Job(small, PRESETS["type1"], 30, seed=0, steps=500))
    assert clean["delivered"] == 24 and clean["finished_at"] == clean["steps"] < 500
    points = 40 * 24 - 0.05 / 30 * clean["collisions"] + 10 * (500 - clean["steps"])
    assert clean["fitness"] == pytest.approx(points, abs=1e-9)
    some = run_job(Job(small, PRESETS["type1"], 30, seed=0, steps=500, stop_at=5))
    assert 5 <= some["delivered"] < 24 and some["finished_at"] == some["steps"] < clean["steps"]
    assert some["fitness"] <= 20 * (some["delivered"] + some["picked"])


def test_long_jobs_begin_first(small, monkeypatch):
    jobs = [
        Job(small, Genome(), 30, seed, steps=steps)
        for seed, steps in enumerate((5, 40, 10, 20, 1, 30))
    ]
    monkeypatch.setattr(pool, "outcomes", lambda jobs, _: [{"seed": job.seed} for job in jobs])
    finished = list(run_jobs(jobs, Execution(workers=1)))
    assert finished == [(index, {"seed": index}) for index in (1, 5, 3, 2, 0, 4)]


@pytest.fixture
def tried(monkeypatch):
    """A stand-in for runs, and how many places for robots those begun have."""
    begun = []

    class Crowded:
        is_over, kind, finished_at = False, 0, {}

        def __init__(self, scenario, *, record_worlds, capacity):
            begun.append(capacity)
            self.sizes = [world.n_robots for world in scenario.worlds]

        def advance(self):
            self.is_over = True

        @property
        def fault_of_each(self):
            """The last world has one."""
            fault = SimulationFault(step=3, world=0, kind=self.kind) if self.kind else None
            return [*[None] * (len(self.sizes) - 1), fault]

        def measures(self, world):
            return Measures(self.sizes[world], 0, 0, None, self.finished_at.get(world))

    monkeypatch.setattr(pool, "Run", Crowded)
    return Crowded, begun


def test_a_fault_names_its_job(small, tried):
    tried[0].kind = FaultKind.TOO_MANY_CONTACTS
    with pytest.raises(
        SimulationFault,
        match=r"^run of 30 robots with seed 77: step 3, world 0: .*contact_capacity",
    ):
        outcomes_of([Job(small, Genome(), 30, seed) for seed in (0, 77)], MJX)


@pytest.mark.parametrize(
    "sizes, capacity",
    [((30, 30), 30), ((64, 50), 64), ((65, 50), 128), ((216, 50), 216)],
)
def test_batches_of_other_sizes_share_a_program(small, tried, sizes, capacity):
    """A program is for arrays of one size; the arena has 216 cells for robots. The first job
    finishes early."""
    tried[0].finished_at = {0: 13}
    found = outcomes_of([Job(small, Genome(), n_robots, 0, steps=20) for n_robots in sizes], MJX)
    assert [outcome["delivered"] for outcome in found] == list(sizes) and tried[1] == [capacity]
    assert [outcome["steps"] for outcome in found] == [13, 20]


@pytest.mark.parametrize("fitting, sizes", [(None, [384]), (200, [192, 192]), (0, [1] * 384)])
def test_batches_of_planar_fit_into_the_memory(monkeypatch, fitting, sizes):
    """Of any sizes, with half of what is free left for what is not estimated."""
    jobs, planar = (
        [SimpleNamespace(n_robots=n) for n in [100, 950, 240] * 128],
        PlanarSettings(1, impl="warp"),
    )
    free = fitting and int(2 * fitting * memory_limits.needed_memory(planar, 1, 950))
    monkeypatch.setattr(memory_limits, "_free_memory", lambda _: free)
    parts = pool._fitting_batches(range(len(jobs)), jobs, planar)
    assert [len(part) for part in parts] == sizes
    assert [index for part in parts for index in part] == list(range(384))


def test_planar_is_run_in_batches_where_there_is_a_gpu(monkeypatch):
    without = Execution(PlanarSettings.usual())
    settings = {"engine": "planar", "refinement": 1, "accuracy": 0.01}
    assert (
        not without.in_batches
        and without.identity == settings
        and without.settings == PlanarSettings(1)
    )
    monkeypatch.setattr("iswarm_mj.engines.settings.can_use_warp", lambda: True)
    with_gpu = Execution(PlanarSettings.usual())
    assert with_gpu.in_batches and with_gpu.identity == settings | {"impl": "warp"}
    assert Execution(MjxSettings.usual()).settings == MjxSettings("warp", contact_capacity=4.0)
    with pytest.raises(
        ConfigError, match="backend must be processes with `engine` planar and `impl` warp"
    ):
        Execution(PlanarSettings.usual(), backend="ray")


def test_jobs_of_batches_end_as_alone(small, monkeypatch):
    """Jobs of two lengths, one with dead robots, as two batches."""
    given = [(1, 20, 0.0), (2, 20, 0.5), (3, 10, 0.0)]
    jobs = [
        Job(small, Genome(), 12, seed, steps=steps, failed_fraction=dead)
        for seed, steps, dead in given
    ]
    begun = []

    def run(scenario, **options):
        begun.append(scenario.n_worlds)
        return Run(scenario, **options)

    monkeypatch.setattr(pool, "Run", run)
    batched = [outcome for _, outcome in pool.run_batches(jobs, PlanarSettings(1))]
    assert begun == [2, 1]
    assert batched == [run_job(job, PlanarSettings(1)) for job in jobs]
    assert sum(o["picked"] for o in batched) > 3
