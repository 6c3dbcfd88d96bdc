"""How deep robots of a whole run push into each other in MuJoCo; run with `pytest -m slow`."""

import numpy as np
import pytest
from support.runs import engine_of
from support.touching import pairs_of

from iswarm_mj.engines.mujoco.settings import MujocoSettings
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.scenario import Scenario
from iswarm_mj.strategy.genome import PRESETS

pytestmark = pytest.mark.slow


def contacts(seed):
    """Depths in all physics steps of a run [mm], its collisions, those that two readings find, and
    those counted."""
    run = Run(
        Scenario(
            strategy=PRESETS["type1"],
            robots=280,
            engine=MujocoSettings(threads=1),
            seed=seed,
            steps=160,
        )
    )
    engine = engine_of(run)
    step, depths, every, found = engine._step, [], 0, 0
    lists = np.zeros(
        (2, 12, engine._capacity), np.int32
    )  # partners in all physics steps, and in those that are read
    before = np.False_

    def step_by_step(n_substeps, worlds, is_jam):
        for _ in range(n_substeps):
            assert step(1, worlds, is_jam) == []
            engine._read_contacts(0, lists[0], np.zeros(1, int))
            contact = engine._batch.get_data(0, engine._scratch).contact
            depths.append(-contact.dist.min(initial=0.0))
        engine._read_contacts(0, lists[1], np.zeros(1, int))
        return []

    engine._step = step_by_step
    while not run.is_over:
        lists[:] = 0
        run.advance()
        touched, read = pairs_of(lists)
        every += (touched & ~before).sum()
        found += (read & ~before).sum()
        before = touched
    return depths, every, found, run.measures(0).collisions


def test_contacts_of_whole_runs():
    """How deep robots run into each other, and what two readings in ten physics steps make of their
    collisions.

    They miss the shortest, and count a contact that comes and goes each time that they find it.
    """
    depths, every, found, counted = zip(*map(contacts, range(1, 5)), strict=True)
    depths, every = np.array(depths), np.array(every)
    deep, found, counted = np.mean(depths > 0.4), np.mean(found / every), np.mean(counted / every)
    print(f"deepest {depths.max():.2f} mm, beyond 0.4 mm in {deep:.1%} of physics steps")
    print(f"{found:.0%} of {every.sum()} collisions found, {counted:.0%} counted")
    assert 0.4 < depths.max() < 0.75 and deep < 0.2
    assert 0.77 < found < 0.83 and 1.13 < counted < 1.25
