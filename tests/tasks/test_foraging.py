"""Foraging: sources that run dry, and a forager that knows its way by its own steps."""

from dataclasses import replace

import jax
import numpy as np
import pytest
from support.runs import records
from support.sensing import remember, senses_nothing, turned
from support.worlds import start_of, task_inputs

from iswarm_mj.config.swarm import ArenaConfig, DriveConfig, SwarmConfig
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.engines.robot_file import read_robot
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.scenario import Scenario
from iswarm_mj.tasks.foraging import Forager, Foraging, _between
from iswarm_mj.tasks.signatures import as_task, check_task
from iswarm_mj.utils.errors import ConfigError
from iswarm_mj.utils.units import RD

SMALL = SwarmConfig(
    ArenaConfig(size=15, dump_size=3, dust_area_size=3, dust_area_offset=5, n_dust=4), DriveConfig(control_period=2.0)
)
TASK = Foraging(sources=2, source_radius=1.0)


def test_items_begin_at_their_sources():
    for index in range(5):
        start = start_of(SMALL, 6, 1, index, task=TASK)
        away = start.task.items.position - start.task.centres[np.arange(4) % 2]
        assert np.hypot(*away.T).max() <= RD + 1e-4
        distance = np.hypot(*start.task.centres.T) / RD
        assert (distance >= 3.25 - 1e-4).all() and (distance <= 6.5 + 1e-4).all()
        areas = TASK.areas(SMALL, start.task)
        np.testing.assert_allclose(areas["dump"], [[0.0, 0.0, 1.5 * RD]], rtol=1e-6)
        np.testing.assert_allclose(areas["sources"], [[x, y, RD] for x, y in start.task.centres], rtol=1e-6)
    assert check_task(as_task(TASK), SMALL, SMALL.static, read_robot(), start.task, 6) == {}
    wide = start_of(replace(SMALL, arena=replace(SMALL.arena, dump_size=6)), 6, 1, 0, task=Foraging(2, 2.0))
    np.testing.assert_allclose(np.hypot(*wide.task.centres.T), 5.5 * RD, rtol=1e-6)  # no room beyond the dump


@pytest.mark.parametrize(
    "task, message",
    [
        (Foraging(source_radius=7.6), r"source_radius must be at most 7.5 rd, half of `arena.size` \(got 7.6\); make"),
        (Foraging(sources=5, source_radius=1.0), r"sources must be at most 4, the items .*\(got 5\); take fewer"),
        (Foraging(sources=0), r"sources must be a whole number between 1 and 100 \(got 0\)"),
        (Foraging(source_radius=-1.0), r"source_radius must be .*\(got -1.0\)"),
    ],
)
def test_sources_that_cannot_be_are_refused(task, message):
    """One without items would run dry at each step."""
    with pytest.raises(ConfigError, match=message):
        start_of(SMALL, 5, 0, 0, task=task)


def test_a_source_moves_when_its_last_item_is_home():
    """Counted from the balls themselves; what is home stays home until then, and items lie at their new source."""
    run = Run(Scenario(SMALL, strategy=Forager(), task=TASK, robots=10, engine=PlanarSettings(2, 2), steps=500, goal=6))
    before, items, moved, there = jax.tree.map(lambda a: a[0], run.start), 0, 0, np.ones(10, bool)
    inputs = task_inputs(SMALL, there, run.robot)
    for after in records(run):
        old, new = before.swarm.task.items, after.swarm.task.items
        after_task = jax.tree.map(lambda a: a[0], after.swarm.task)
        home = after_task.is_home
        assert (old.is_held[0][home]).all() and not new.is_held[0][home].any()
        items += home.sum()
        rewards = TASK.reward(after_task, after_task, inputs._replace(poses=after.poses[0]))
        np.testing.assert_array_equal(rewards, np.bincount(new.holder[0][home], minlength=10))
        moves = (after.swarm.task.centres != before.swarm.task.centres).any(axis=-1)[0]
        source = np.arange(4) % 2
        for place in range(2):
            was_last = (new.is_delivered[0] | home)[source == place].all() or moves[place]
            assert moves[place] == (was_last and home[source == place].any())
        back = moves[source]
        assert not new.is_delivered[0][back].any()
        away = new.position[0] - after.swarm.task.centres[0][source]
        assert (np.hypot(*away[back].T) <= RD + 1e-4).all()
        assert (new.is_delivered[0][~back] == (old.is_delivered[0] | home)[~back]).all()
        moved, before = moved + moves.sum(), after
    found = {name: values[0] for name, values in run.metrics().items()}
    assert found["items"] == items == run.progress()[0] >= 6 and found["moves"] == moved >= 2
    assert run.measures(0).finished_at == run.step
    np.testing.assert_allclose(found["rate"], 30 * items / run.step, rtol=1e-6)


def test_what_foragers_do():
    """Each row: food and home as they are known, what is changed of an observation of nothing, turn and step expected.

    The tool's reach is 1 mm, and a step half a diameter; robots turn by 90 degrees at most, and only then walk on. They
    forget where nothing can be lifted, and search at home for the tip of the dump.
    """
    half, right, wall, near = 0.5 * RD, np.pi / 2, [True, False, False, False], {"is_heard": [True] * 4}
    item, near = {"at_dust": True, "ball_vector": [1.2, 0.5]}, near | {"distance": [1.3 * RD] + [5.0] * 3}
    beside, far = near | {"distance": [5.0, *[1.3 * RD] * 3]}, near | {"distance": [1.5 * RD] * 4}
    rows = [
        (None, None, item, np.arctan2(0.5, 1.2), 0.3),
        (None, None, item | near, np.arctan2(0.5, 1.2), 0.3),
        ((9, 0), (0, 9), item | {"is_loaded": True}, right, half),
        ((9, 9), (0, 9), item | {"grasp_failed": True}, "random", half),
        ((9, 9), (0, 9), {}, np.pi / 4, half),
        ((9, -9), (0, 9), {"sees_wall": wall}, -np.pi / 4, half),
        ((9, -9), None, {"is_loaded": True, "sees_wall": wall}, "aside", half),
        ((-9, 1), None, {}, right, 0.0),
        ((9, 0), None, near, "aside", half),
        ((9, 9), None, beside, np.pi / 4, half),
        ((9, 9), None, far, np.pi / 4, half),
        (None, None, {"sees_wall": wall[::-1]}, "random", half),
        (None, None, {"on_dump": True, "is_loaded": True}, "random", half),
        (None, None, {"at_dust": True, "ball_vector": [-4.0, -0.1]}, -right, 0.0),
        (None, None, {"at_dust": True, "ball_vector": [0.2, 0.1]}, np.arctan2(0.1, 0.2), np.hypot(0.1, 0.2) - 1.0),
    ]
    forager, copies, n = replace(Forager(), reach=1.0), 40, 40 * len(rows)
    food, home = (
        remember([row[k] or (0, 0) for row in rows] * copies, known=[row[k] is not None for row in rows] * copies)
        for k in (0, 1)
    )
    seen = senses_nothing(n)
    changed = {name: np.array(getattr(seen, name)) for name in {name for row in rows for name in row[2]}}
    for k, row in enumerate(rows):
        for name, value in row[2].items():
            changed[name][k :: len(rows)] = value
    memory, command = forager.act({"home": home, "food": food}, seen._replace(**changed), jax.random.key(2))
    assert not memory["food"].known[3]
    for k, name, place in ((0, "food", (1.2, 0.5)), (4, "food", (9, 9)), (4, "home", (0, 9)), (12, "home", (0, 0))):
        there = turned(np.add(memory[name].vector[k], [command.forward[k], 0]), command.turn[k])
        np.testing.assert_allclose(there, place, atol=1e-5)  # places stay as robots move
        assert memory[name].known[k]
    turns, steps = (np.asarray(values).reshape(copies, -1).T for values in command)
    for (*_, turn, step), found, walked in zip(rows, turns, steps, strict=True):
        np.testing.assert_allclose(walked, step, atol=1e-5)
        if turn == "random":
            assert np.radians(20) < np.abs(found).max() <= np.radians(25) and 0.2 < (found > 0).mean() < 0.8
        elif turn == "aside":
            np.testing.assert_allclose(np.abs(found), right, rtol=1e-6)
            assert 0.2 < (found > 0).mean() < 0.8
        else:
            np.testing.assert_allclose(found, turn, atol=1e-6)


def test_places_are_spread_evenly_over_their_ring():
    """Half of all points lie within the circle that halves the ring's area."""
    away = np.hypot(*np.asarray(_between((3.0, 9.0), 20_000, jax.random.key(0))).T)
    assert away.min() >= 3.0 - 1e-5 and away.max() <= 9.0 + 1e-5
    np.testing.assert_allclose(np.mean(away < np.sqrt((9 + 81) / 2)), 0.5, atol=0.02)
