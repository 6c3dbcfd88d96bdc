"""Contacts of robots in whole runs in MuJoCo: how deep they are, and which of them are counted."""

from typing import NamedTuple

import numpy as np
import pytest
from support.runs import engine_of
from support.touching import pairs_of

from iswarm_mj.engines.mujoco.settings import MujocoSettings
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.scenario import Scenario
from iswarm_mj.strategy.genome import PRESETS

pytestmark = pytest.mark.slow
MAX_PARTNERS = 12
"""Robots that touch one robot in a control step at most."""


class Contacts(NamedTuple):
    """Contacts of a run."""

    depths: list[float]
    """Depth of the deepest contact in each time step [mm]."""
    n_collisions: int
    """Collisions by the contacts of all physics steps."""
    n_read: int
    """Those by two readings in a control step."""
    n_counted: int
    """Those that the run has counted."""


def contacts_of_run(seed):
    """Run a swarm, whose engine is watched in each physics step, and return its contacts."""
    scenario = Scenario(
        strategy=PRESETS["type1"],
        robots=280,
        engine=MujocoSettings(threads=1),
        seed=seed,
        steps=160,
    )
    run = Run(scenario)
    engine = engine_of(run)
    step = engine._step
    depths = []
    partners = np.zeros((2, MAX_PARTNERS, engine._capacity), np.int32)
    of_all_steps, of_readings = partners

    def step_one_by_one(n_substeps, worlds, is_jam):
        for _ in range(n_substeps):
            assert step(1, worlds, is_jam) == []
            engine._read_contacts(0, of_all_steps, np.zeros(1, int))
            contact = engine._batch.get_data(0, engine._scratch).contact
            depths.append(-contact.dist.min(initial=0.0))
        engine._read_contacts(0, of_readings, np.zeros(1, int))
        return []

    engine._step = step_one_by_one
    n_collisions = 0
    n_read = 0
    touched_before = np.False_
    while not run.is_over:
        partners[:] = 0
        run.advance()
        touched, read = pairs_of(partners)
        n_collisions += (touched & ~touched_before).sum()
        n_read += (read & ~touched_before).sum()
        touched_before = touched
    return Contacts(depths, n_collisions, n_read, run.measures(0).collisions)


@pytest.fixture(scope="module")
def runs():
    """Return the contacts of four runs."""
    return [contacts_of_run(seed) for seed in range(1, 5)]


def test_contacts_are_rarely_deep(runs):
    depths = np.array([run.depths for run in runs])
    share_of_deep = np.mean(depths > 0.1)
    print(f"deepest {depths.max():.2f} mm, beyond 0.1 mm in {share_of_deep:.1%} of time steps")
    assert depths.max() < 0.4
    assert share_of_deep < 0.1


def test_two_readings_in_ten_physics_steps_miss_short_contacts(runs):
    """They count a contact that comes and goes each time that they find it."""
    n_collisions = np.array([run.n_collisions for run in runs])
    share_read = np.mean([run.n_read for run in runs] / n_collisions)
    share_counted = np.mean([run.n_counted for run in runs] / n_collisions)
    print(f"{share_read:.0%} of {n_collisions.sum()} collisions found, {share_counted:.0%} counted")
    assert 0.74 < share_read < 0.80
    assert 1.02 < share_counted < 1.12
