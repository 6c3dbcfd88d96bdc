"""Senders in sight of one side of a robot, in crowds of whole runs: more than count are rare."""

from dataclasses import replace

import numpy as np
import pytest

from iswarm_mj.config.static import SENDERS_IN_SIGHT
from iswarm_mj.config.swarm import OpticsConfig, SwarmConfig
from iswarm_mj.engines.arena import compile_arena
from iswarm_mj.engines.planar.engine import PlanarEngine
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.scenario import Scenario
from iswarm_mj.strategy.genome import PRESETS

pytestmark = pytest.mark.slow
STEPS = 150
INTERVAL = 10
"""Control steps from one look to the next."""
MAX_SENDERS = 20
"""Senders of a side that are counted here, more than a run does."""


@pytest.mark.parametrize(("n_robots", "n_worlds"), [(280, 4), (785, 2)])
@pytest.mark.parametrize("mode", ["sector", "power"])
def test_hardly_any_side_has_more_senders_than_count(mode, n_robots, n_worlds):
    config = replace(SwarmConfig(), optics=OpticsConfig(mode=mode, baud_rate=30000.0))
    scenario = Scenario(
        config,
        strategy=PRESETS["type1"],
        robots=n_robots,
        engine=PlanarSettings(refinement=1),
        worlds=n_worlds,
        steps=STEPS,
    )
    run = Run(scenario)
    engine = PlanarEngine(config, compile_arena(config, 1, np.zeros(0)))
    engine._light = engine._light._replace(n_senders=MAX_SENDERS)

    all_robots = np.ones((n_worlds, n_robots), bool)
    all_worlds = np.ones(n_worlds, bool)
    n_sides = np.zeros(MAX_SENDERS + 1, int)
    while not run.is_over:
        run.advance()
        if run.step % INTERVAL == 0:
            _, state = run.arrays()
            bodies = engine.place(state.bodies.poses, all_robots)
            n_senders = engine.sense(bodies, all_robots, all_worlds).links.valid.sum(axis=-1)
            n_sides += np.bincount(n_senders.ravel(), minlength=MAX_SENDERS + 1)

    shown = np.trim_zeros(n_sides, "b").tolist()
    print(f"{n_robots} robots, {mode}: sides by number of senders in sight, {shown}")
    n_hearing = n_sides[1:].sum()
    assert n_hearing > 5000
    assert n_sides[SENDERS_IN_SIGHT + 1 :].sum() <= 1e-4 * n_hearing
