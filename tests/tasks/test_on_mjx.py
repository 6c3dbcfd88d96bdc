"""Tasks on MJX: the same start as on the planar engine, counts that follow from the poses and balls there."""

import jax
import numpy as np
import pytest
from helpers_mjx import mjx

from iswarm_mj.config import ArenaConfig, SwarmConfig
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.settings import RunSettings
from iswarm_mj.tasks.aggregation import Aggregation, Beeclust
from iswarm_mj.tasks.foraging import Forager, Foraging
from iswarm_mj.utils.units import RD

SMALL = SwarmConfig(ArenaConfig(size=12, dump_size=3, dust_area_size=2, dust_area_offset=4, n_dust=4))
SETTINGS = RunSettings(8, 75, n_worlds=2, record_worlds=(0, 1))


def records(task, strategy, engine):
    """The start and all further steps (T, 2, ...), after a run without faults."""
    run = Run(SMALL, None, SETTINGS, engine, strategy=strategy, task=task)
    found = [run.start]
    while not run.is_over:
        found.append(run.advance())
    run.raise_faults()
    return run, jax.tree.map(lambda *parts: np.concatenate(parts), *found)


@pytest.mark.slow
def test_aggregation():
    """What a step counts is where robots were before it; beside walls and others they stay in the arena."""
    task = Aggregation(spot_radius=3.0, spot_offset=3.0, dim=0.5)
    run, mine = records(task, Beeclust(), mjx(chunk=25))
    _, planar = records(task, Beeclust(), PlanarSettings(1))
    np.testing.assert_array_equal(mine.poses[0], planar.poses[0])
    own = mine.swarm.task
    for world in range(2):
        for step in range(1, 76):
            light = np.asarray(task.light(mine.poses[step - 1, world], own.east[step, world]))
            np.testing.assert_allclose(own.shares[step, world], (light > 0).mean(axis=0), atol=1e-6)
    waits = mine.swarm.memory["wait"]
    assert waits.max() > 1 and np.abs(mine.poses[..., :2]).max() < 6 * RD
    np.testing.assert_array_equal(run.metrics()["bright"], own.shares[-1, :, 0])
    assert np.ptp(own.shares[..., 0]) > 0


@pytest.mark.slow
def test_foraging():
    """Items that are home were held by a robot on the dump; as many as the task counts."""
    run, found = records(Foraging(sources=2, source_radius=1.0), Forager(), mjx(chunk=25))
    own = found.swarm.task
    balls, home = own.items, own.is_home
    assert (np.cumsum(home.sum(axis=-1), axis=0) == own.n_home).all() and own.n_home[-1].sum() > 0
    step, world, ball = np.nonzero(home)
    assert balls.is_held[step - 1, world, ball].all() and not balls.is_held[step, world, ball].any()
    holder = balls.holder[step - 1, world, ball]
    assert np.abs(found.poses[step - 1, world, holder, :2]).max() < 1.5 * RD + 1e-3
    np.testing.assert_array_equal(run.progress(), own.n_home[-1])
