"""Whole runs of the planar engine against those of MuJoCo in C, as samples of one distribution.

`pytest -m slow tests/agreement/test_planar_runs.py -s` prints means and p. The rule was fixed before the runs: they
agree if p is above 0.01 in each of three Kolmogorov-Smirnov tests.
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
N_WORLDS, GOAL, EARLY, STEPS = 24, 66, 150, 800
ENGINES = {
    "numba": PlanarSettings(),
    "warp": PlanarSettings(impl="warp"),
    "numba, finer time step": PlanarSettings(refinement=10),
    "C": MujocoSettings(),
}


@cache
def outcomes(engine, preset, seed):
    """Samples of N_WORLDS runs until GOAL deliveries."""
    config, genome = SwarmConfig(), PRESETS[preset]
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
    early = None
    while not run.is_over:
        run.advance()
        if early is None and run.step >= EARLY:
            early = run.progress()
    run.raise_faults()
    measures = [run.measures(world) for world in range(N_WORLDS)]
    return {
        "finishing time": [m.finished_at or STEPS for m in measures],
        f"deliveries after {EARLY} steps": early,
        "collisions": [m.collisions for m in measures],
    }


@pytest.mark.parametrize("preset", ["type1", "type2"])
@pytest.mark.parametrize("engine", ["numba", "warp", "numba, finer time step"])
def test_runs_are_distributed_as_those_of_mujoco(engine, preset):
    """The worlds of other seeds than in C, so that the samples are independent."""
    if engine == "warp":
        pytest.importorskip("warp")
    ours, theirs = outcomes(engine, preset, 100), outcomes("C", preset, 200)
    found = {what: float(ks_2samp(ours[what], theirs[what]).pvalue) for what in ours}
    for what, p in found.items():
        print(f"{preset}, {engine}: {what} {np.mean(ours[what]):.1f}, in C {np.mean(theirs[what]):.1f}, p = {p:.2g}")
    assert min(found.values()) > 0.01
