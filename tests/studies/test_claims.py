"""The paper's statements on the cleaning swarm (section 4.6), by MuJoCo in C, six seeds; run with `pytest -m slow`."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers_runs import engine_of

from iswarm_mj.config import OpticsConfig, SwarmConfig
from iswarm_mj.engines.mujoco.settings import MujocoSettings
from iswarm_mj.experiments.analysis.statistics import compare
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.settings import RunSettings
from iswarm_mj.strategy.genome import PRESETS, Genome
from iswarm_mj.tasks.layout import robots_for
from iswarm_mj.tasks.measures import Measures
from iswarm_mj.utils.tables import read_table

pytestmark = pytest.mark.slow
SEEDS = range(6)
ROOT = Path(__file__).parents[2]
PAPER = SwarmConfig()


def outcomes(genome: Genome, steps: int, config: SwarmConfig = PAPER, stop_at: int = 66) -> list[Measures]:
    """Measures of six swarms, stopped at so many of 72 balls."""
    measures = []
    n_robots = robots_for(config.arena, genome.density_of_robots)
    for seed in SEEDS:
        settings = RunSettings(n_robots, steps, seed, stop_at=stop_at, record_worlds=())
        run = Run(config, genome, settings, MujocoSettings(threads=1))
        while not run.is_over:
            run.advance()
        run.raise_faults()
        measures.append(run.measures(0))
    print([m.finished_at or f"- ({m.delivered})" for m in measures])
    return measures


@pytest.fixture(scope="module")
def evolved() -> dict[str, list[Measures]]:
    return {name: outcomes(PRESETS[name], 500) for name in ("type1", "type2")}


def finishing_times(measures: list[Measures]) -> np.ndarray:
    """Control steps after which the swarms had delivered their balls; all of them must have."""
    times = [m.finished_at for m in measures]
    assert None not in times
    return np.array(times)


def at_least(measures: list[Measures], steps: int) -> np.ndarray:
    """As `finishing_times`, of swarms that may not finish within so many steps, which is less than they need."""
    return np.array([m.finished_at or steps for m in measures])


@pytest.mark.parametrize("name", ["type1", "type2"])
def test_both_types_clean_the_arena_as_in_the_results(name):
    """These are by the planar engine, 96 runs; all 72 balls."""
    times = finishing_times(outcomes(PRESETS[name], 800, stop_at=72))
    rows, _ = read_table(ROOT / "results/types/types.parquet")
    theirs = [row["finished_at"] or 800 for row in rows if row["type"] == name]
    assert compare(times, theirs).p > 0.001


def test_the_first_type_is_the_faster_one(evolved):
    one, other = (finishing_times(evolved[name]).mean() for name in ("type1", "type2"))
    assert 1.05 * one < other < 1.35 * one


@pytest.mark.parametrize("name", ["type1", "type2"])
def test_without_hop_counts_no_swarm_cleans_the_arena(name):
    measures = outcomes(replace(PRESETS[name], use_hop_count=False), 600)
    assert [m.finished_at for m in measures] == [None] * len(measures)
    assert max(m.delivered for m in measures) < 60


def test_a_sparse_swarm_is_slower_than_the_evolved_density(evolved):
    sparse = at_least(outcomes(replace(PRESETS["type1"], density_of_robots=0.05), 500), 500)
    dense = finishing_times(evolved["type1"])
    assert sparse.min() > dense.max() and sparse.mean() > 1.5 * dense.mean()


def test_wrong_messages_that_pass_the_parity_slow_the_swarm_down(evolved):
    fooled = at_least(
        outcomes(PRESETS["type1"], 800, SwarmConfig(optics=OpticsConfig(independent_bit_errors=True))), 800
    )
    assert fooled.mean() > 1.15 * finishing_times(evolved["type1"]).mean()


def test_contacts_of_a_whole_run():
    """How deep robots run into each other, and what two readings in ten physics steps make of their collisions.

    They miss the shortest, and count a contact that comes and goes each time that they find it.
    """
    run = Run(PAPER, PRESETS["type1"], RunSettings(280, 160, seed=1), MujocoSettings(threads=1))
    engine = engine_of(run)
    step, depths, every = engine._step, [], 0
    touched, before, read = np.zeros((3, 1, 280, 280), bool)
    found = 0

    def step_by_step(n_substeps, worlds, is_jam):
        for _ in range(n_substeps):
            assert step(1, worlds, is_jam) == []
            engine._read_contacts(0, touched, np.zeros(1, int))
            contact = engine._batch.get_data(0, engine._scratch).contact
            depths.append(-contact.dist.min(initial=0.0))
        engine._read_contacts(0, read, np.zeros(1, int))
        return []

    engine._step = step_by_step
    while not run.is_over:
        touched[:], read[:] = False, False
        run.advance()
        every += (touched & ~before).sum()
        found += (read & ~before).sum()
        before = touched.copy()
    counted, deep = run.measures(0).collisions, np.mean(np.array(depths) > 0.4)
    print(f"deepest {max(depths):.2f} mm, beyond 0.4 mm in {deep:.1%} of physics steps")
    print(f"{found / every:.0%} of {every} collisions found, {counted / every:.0%} counted")
    assert 0.4 < max(depths) < 0.75 and deep < 0.2
    assert 0.74 < found / every < 0.86 and 1.07 < counted / every < 1.19
