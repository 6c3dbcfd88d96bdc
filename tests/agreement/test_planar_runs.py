"""Whole runs of the planar engine against those of MuJoCo in C, as samples of one distribution.

`pytest -m slow tests/agreement/test_planar_runs.py -s` prints means and p. The rule was fixed
before the runs: they agree if p is above 0.01 in each of three Kolmogorov-Smirnov tests.
"""

from functools import cache

import numpy as np
import pytest
from scipy.stats import ks_2samp

from iswarm_mj.config.swarm import SwarmConfig
from iswarm_mj.engines.mujoco.settings import MujocoSettings
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.scenario import Scenario
from iswarm_mj.strategy.genome import PRESETS
from iswarm_mj.tasks.layout import robots_for

pytestmark = pytest.mark.slow

N_WORLDS = 24
GOAL = 66
"""Number of deliveries that finish a run."""
EARLY = 150
"""Control step after which deliveries are counted."""
STEPS = 800
LEAST_P = 0.01
ENGINES = {
    "numba": PlanarSettings(),
    "warp": PlanarSettings(impl="warp"),
    "numba, finer time step": PlanarSettings(refinement=10),
    "C": MujocoSettings(),
}


@cache
def outcomes(engine, preset, seed):
    """Return samples of N_WORLDS runs until GOAL deliveries, by the names of their measures."""
    config = SwarmConfig()
    genome = PRESETS[preset]
    n_robots = robots_for(config.arena, genome.density_of_robots)
    scenario = Scenario(
        config,
        strategy=genome,
        robots=n_robots,
        engine=ENGINES[engine],
        seed=seed,
        worlds=N_WORLDS,
        steps=STEPS,
        goal=GOAL,
    )
    run = Run(scenario, record_worlds=())
    early_deliveries = None
    while not run.is_over:
        run.advance()
        if early_deliveries is None and run.step >= EARLY:
            early_deliveries = run.progress()
    run.raise_faults()
    measures = [run.measures(world) for world in range(N_WORLDS)]
    return {
        "finishing time": [m.finished_at or STEPS for m in measures],
        f"deliveries after {EARLY} steps": early_deliveries,
        "collisions": [m.collisions for m in measures],
    }


@pytest.mark.parametrize("preset", ["type1", "type2"])
@pytest.mark.parametrize("engine", ["numba", "warp", "numba, finer time step"])
def test_runs_are_distributed_as_those_of_mujoco(engine, preset):
    """The worlds have other seeds than in C, so that the samples are independent."""
    if engine == "warp":
        pytest.importorskip("warp")
    samples = outcomes(engine, preset, seed=100)
    samples_in_c = outcomes("C", preset, seed=200)
    p_values = {}
    for name, sample in samples.items():
        sample_in_c = samples_in_c[name]
        p_values[name] = float(ks_2samp(sample, sample_in_c).pvalue)
        print(
            f"{preset}, {engine}: {name} {np.mean(sample):.1f}, "
            f"in C {np.mean(sample_in_c):.1f}, p = {p_values[name]:.2g}"
        )
    assert min(p_values.values()) > LEAST_P
