"""How deep robots of a whole run push into each other in MuJoCo; run with `pytest -m slow`."""

import numpy as np
import pytest
from helpers_runs import engine_of

from iswarm_mj.config import SwarmConfig
from iswarm_mj.engines.mujoco.settings import MujocoSettings
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.settings import RunSettings
from iswarm_mj.strategy.genome import PRESETS

pytestmark = pytest.mark.slow


def test_contacts_of_a_whole_run():
    """How deep robots run into each other, and what two readings in ten physics steps make of their collisions.

    They miss the shortest, and count a contact that comes and goes each time that they find it.
    """
    run = Run(SwarmConfig(), PRESETS["type1"], RunSettings(280, 160, seed=1), MujocoSettings(threads=1))
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
