"""The paper's statements on the cleaning swarm (section 4.6), over six seeds each; run with `pytest -m slow`."""

from dataclasses import replace

import numpy as np
import pytest
from iswarm_mj.simulation.run_mujoco import Run, RunSettings

from iswarm_mj.config import OpticsConfig, SwarmConfig
from iswarm_mj.simulation.initial import robots_for
from iswarm_mj.simulation.metrics import Measures
from iswarm_mj.strategy.genome import PRESETS, Genome

pytestmark = pytest.mark.slow
SEEDS = range(6)
PAPER = SwarmConfig()


def outcomes(genome: Genome, steps: int, config: SwarmConfig = PAPER) -> list[Measures]:
    """Measures of six swarms, stopped at 66 of 72 balls."""
    measures = []
    n_robots = robots_for(config.arena, genome.density_of_robots)
    for seed in SEEDS:
        run = Run(config, genome, RunSettings(n_robots, steps, seed, n_threads=1, stop_at=66))
        while not run.is_over:
            run.advance()
        measures.append(run.measures(0))
    print([m.finished_at or f"- ({m.delivered})" for m in measures])
    return measures


@pytest.fixture(scope="module")
def evolved() -> dict[str, list[Measures]]:
    return {name: outcomes(PRESETS[name], 500) for name in ("type1", "type2")}


@pytest.mark.parametrize("name", ["type1", "type2"])
def test_both_evolved_types_clean_the_arena(evolved, name):
    finished = [m.finished_at for m in evolved[name] if m.finished_at is not None]
    assert len(finished) >= 5


@pytest.mark.parametrize("name", ["type1", "type2"])
def test_without_hop_counts_no_swarm_cleans_the_arena(name):
    measures = outcomes(replace(PRESETS[name], use_hop_count=False), 600)
    assert [m.finished_at for m in measures] == [None] * len(measures)


def test_a_sparse_swarm_is_slower_than_the_evolved_density(evolved):
    sparse = outcomes(replace(PRESETS["type1"], density_of_robots=0.05), 500)
    mean = [sum(m.finished_at or 500 for m in measures) / len(measures) for measures in (sparse, evolved["type1"])]
    assert mean[0] > 1.2 * mean[1]


def test_wrong_messages_that_pass_the_parity_slow_the_swarm_down(evolved):
    fooled = outcomes(PRESETS["type1"], 800, SwarmConfig(optics=OpticsConfig(independent_bit_errors=True)))
    mean = [np.mean([m.finished_at or 800 for m in measures]) for measures in (fooled, evolved["type1"])]
    assert mean[0] > 1.2 * mean[1]


def test_contacts_of_a_whole_run():
    """How deep robots run into each other, and how many collisions two readings in ten physics steps find."""
    run = Run(PAPER, PRESETS["type1"], RunSettings(280, 160, seed=1, n_threads=1))
    engine, step = run.engine, run.engine.advance
    depths, touched, before, every = [], set(), set(), 0

    def advance(velocity, n_substeps, worlds):
        for _ in range(n_substeps):
            step(velocity, 1, worlds)
            touched.update(engine.contacts(0).tolist())
            contact = engine._batch.get_data(0, engine._scratch).contact
            depths.append(-contact.dist.min(initial=0.0))

    engine.advance = advance
    while not run.is_over:
        touched.clear()
        run.advance()
        every += len(touched - before)
        before = set(touched)
    share, deep = run.collisions[0] / every, np.mean(np.array(depths) > 0.4)
    print(
        f"deepest {max(depths):.2f} mm, beyond 0.4 mm in {deep:.1%} of physics steps, {share:.0%} of collisions found"
    )
    assert max(depths) < 0.75
    assert share > 0.8
