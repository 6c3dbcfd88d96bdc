"""How many senders are in sight of one side of a robot, in crowds of whole runs, and how many of
them count."""

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
EVERY, STEPS, MANY = 10, 150, 20


@pytest.mark.parametrize(("n_robots", "n_worlds"), [(280, 4), (785, 2)])
@pytest.mark.parametrize("mode", ["sector", "power"])
def test_hardly_any_side_has_more_senders_than_count(mode, n_robots, n_worlds):
    config = replace(SwarmConfig(), optics=OpticsConfig(mode=mode, baud_rate=30000.0))
    run = Run(
        Scenario(
            config,
            strategy=PRESETS["type1"],
            robots=n_robots,
            engine=PlanarSettings(refinement=1),
            worlds=n_worlds,
            steps=STEPS,
        )
    )
    engine = PlanarEngine(config, compile_arena(config, 1, np.zeros(0)))
    engine._light = engine._light._replace(n_senders=MANY)
    everyone, running = np.ones((n_worlds, n_robots), bool), np.ones(n_worlds, bool)
    counts = np.zeros(MANY + 1, int)
    while not run.is_over:
        run.advance()
        if run.step % EVERY == 0:
            bodies = engine.place(run.arrays()[1].bodies.poses, everyone)
            senders = engine.sense(bodies, everyone, running).links.valid.sum(axis=-1)
            counts += np.bincount(senders.ravel(), minlength=MANY + 1)
    print(
        f"{n_robots} robots, {mode}: sides by number of senders in sight, {np.trim_zeros(counts, 'b').tolist()}"
    )
    hearing = counts[1:].sum()
    assert hearing > 5000 and counts[SENDERS_IN_SIGHT + 1 :].sum() <= 1e-4 * hearing
