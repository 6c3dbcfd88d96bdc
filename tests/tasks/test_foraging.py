"""Foraging: sources that run dry, and foragers that find their way by their own odometry."""

from dataclasses import replace

import jax
import numpy as np
import pytest
from support.runs import records
from support.sensing import remember, senses_nothing, turned
from support.settings import refused_setting
from support.worlds import start_of, task_inputs

from iswarm_mj.config.swarm import ArenaConfig, DriveConfig, SwarmConfig
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.engines.robot_file import read_robot
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.scenario import Scenario
from iswarm_mj.tasks.foraging import Forager, Foraging, draw_in_ring
from iswarm_mj.tasks.validation import as_task, check_task
from iswarm_mj.utils.units import RD

SMALL = SwarmConfig(
    ArenaConfig(size=15, dump_size=3, dust_area_size=3, dust_area_offset=5, n_dust=4),
    DriveConfig(control_period=2.0),
)
TASK = Foraging(sources=2, source_radius=1.0)
SOURCE_OF_ITEM = np.array([0, 1, 0, 1])
"""Source of each of the 4 items."""
ROUNDING = 1e-4
"""Rounding error of positions [mm]."""


def length(vector):
    """Return the lengths of vectors (..., 2)."""
    return np.linalg.norm(vector, axis=-1)


@pytest.mark.parametrize("index", range(5))
def test_items_start_at_their_sources(index):
    start = start_of(SMALL, 6, 1, index, task=TASK)
    sources = start.task

    from_source = sources.items.position - sources.centres[SOURCE_OF_ITEM]
    assert length(from_source).max() <= RD + ROUNDING

    nearest = 0.75 * 3 + 1.0
    farthest = 7.5 - 1.0
    distance = length(sources.centres)
    assert distance.min() >= nearest * RD - ROUNDING
    assert distance.max() <= farthest * RD + ROUNDING


def test_areas_are_the_dump_and_the_sources():
    sources = start_of(SMALL, 6, 1, 0, task=TASK).task
    areas = TASK.areas(SMALL, sources)
    np.testing.assert_allclose(areas["dump"], [[0.0, 0.0, 1.5 * RD]], rtol=1e-6)
    expected = [[x, y, RD] for x, y in sources.centres]
    np.testing.assert_allclose(areas["sources"], expected, rtol=1e-6)


def test_it_is_a_task():
    start = start_of(SMALL, 6, 1, 0, task=TASK)
    sensed = check_task(as_task(TASK), SMALL, SMALL.static, read_robot(), start.task, 6)
    assert sensed == {}


def test_sources_touch_the_walls_where_there_is_no_room_beyond_the_dump():
    large_dump = replace(SMALL, arena=replace(SMALL.arena, dump_size=6))
    start = start_of(large_dump, 6, 1, 0, task=Foraging(sources=2, source_radius=2.0))
    np.testing.assert_allclose(length(start.task.centres), 5.5 * RD, rtol=1e-6)


@pytest.mark.parametrize(
    ("fields", "name", "constraint"),
    [
        ({"source_radius": 7.6}, "source_radius", "at most 7.5 rd, half of `arena.size`"),
        ({"sources": 5, "source_radius": 1.0}, "sources", "at most 4, the items"),
        ({"sources": 0}, "sources", "a whole number between 1 and 100"),
        ({"source_radius": -1.0}, "source_radius", "above 0"),
    ],
)
def test_sources_that_cannot_be_are_refused(fields, name, constraint):
    """One without items would run dry at each step."""
    with refused_setting(name, fields[name], constraint):
        start_of(SMALL, 5, 0, 0, task=Foraging(**fields))


@pytest.mark.slow
def test_a_source_moves_when_its_last_item_is_home():
    """Home is counted from the balls themselves.

    What is home stays there until then, and items lie at their new source.
    """
    scenario = Scenario(
        SMALL,
        strategy=Forager(),
        task=TASK,
        robots=10,
        engine=PlanarSettings(2, 2),
        steps=500,
        goal=6,
    )
    run = Run(scenario)
    inputs = task_inputs(SMALL, np.ones(10, bool), run.robot)
    before = first_world(first_world(run.start.swarm.task))
    n_home = 0
    n_moves = 0
    for record in records(run):
        after = first_world(record.swarm.task)
        items = after.items
        is_home = after.is_home
        n_home += is_home.sum()

        # Items that came home were held before, and earn a point for the robot that held them.
        assert before.items.is_held[is_home].all()
        assert not items.is_held[is_home].any()
        rewards = TASK.reward(after, after, inputs._replace(poses=record.poses[0]))
        np.testing.assert_array_equal(rewards, np.bincount(items.holder[is_home], minlength=10))

        # A source moves exactly when its last item comes home.
        moves = (after.centres != before.centres).any(axis=-1)
        n_moves += moves.sum()
        for source in range(2):
            of_source = source == SOURCE_OF_ITEM
            all_home = (items.is_delivered | is_home)[of_source].all() or moves[source]
            assert moves[source] == (all_home and is_home[of_source].any())

        # The items of a source that moved lie there; all others stay.
        returns = moves[SOURCE_OF_ITEM]
        assert not items.is_delivered[returns].any()
        from_source = items.position - after.centres[SOURCE_OF_ITEM]
        assert (length(from_source[returns]) <= RD + ROUNDING).all()
        was_delivered = before.items.is_delivered | is_home
        assert (items.is_delivered[~returns] == was_delivered[~returns]).all()

        before = after

    metrics = first_world(run.metrics())
    assert metrics["items"] == n_home == run.progress()[0] >= 6
    assert metrics["moves"] == n_moves >= 2
    assert run.measures(0).finished_at == run.step
    control_period = 2.0
    per_minute = 60.0 / control_period * n_home / run.step
    np.testing.assert_allclose(metrics["rate"], per_minute, rtol=1e-6)


def first_world(tree):
    """Return the arrays of the first world."""
    return jax.tree.map(lambda values: values[0], tree)


QUARTER = np.pi / 2
HALF_RD = 0.5 * RD
"""Length of a forager's step [mm]."""
FRONT = [True, False, False, False]
BACK = [False, False, False, True]
ROBOT_AHEAD = {"is_heard": [True] * 4, "distance": [1.3 * RD, 5.0, 5.0, 5.0]}
ROBOTS_BESIDE = {"is_heard": [True] * 4, "distance": [5.0, 1.3 * RD, 1.3 * RD, 1.3 * RD]}
ROBOTS_FAR_AWAY = {"is_heard": [True] * 4, "distance": [1.5 * RD] * 4}
ITEM = {"at_dust": True, "ball_vector": [1.2, 0.5]}
TO_ITEM = np.arctan2(0.5, 1.2)
REACH = 1.0
"""Distance of the tool ahead of the robot's centre [mm]."""
RANDOM = "random"
"""A turn of at most 25 degrees to either side."""
ASIDE = "aside"
"""A quarter turn to either side."""


@pytest.mark.parametrize(
    ("food", "home", "senses", "turn", "step"),
    [
        # An item within reach is lifted: turn first, then bring the tool over it.
        (None, None, ITEM, TO_ITEM, np.hypot(1.2, 0.5) - REACH),
        (None, None, ITEM | ROBOT_AHEAD, TO_ITEM, np.hypot(1.2, 0.5) - REACH),
        (None, None, {"at_dust": True, "ball_vector": [-4.0, -0.1]}, -QUARTER, 0.0),
        (
            None,
            None,
            {"at_dust": True, "ball_vector": [0.2, 0.1]},
            np.arctan2(0.1, 0.2),
            np.hypot(0.2, 0.1) - REACH,
        ),
        # An item that could not be lifted is forgotten.
        ((9, 9), (0, 9), ITEM | {"grasp_failed": True}, RANDOM, HALF_RD),
        # Loaded robots go home, at home they look for the tip of the dump.
        ((9, 0), (0, 9), ITEM | {"is_loaded": True}, QUARTER, HALF_RD),
        (None, None, {"on_dump": True, "is_loaded": True}, RANDOM, HALF_RD),
        # Empty robots go to food, past walls, and turn by at most a quarter before they walk.
        ((9, 9), (0, 9), {}, np.pi / 4, HALF_RD),
        ((9, -9), (0, 9), {"sees_wall": FRONT}, -np.pi / 4, HALF_RD),
        ((-9, 1), None, {}, QUARTER, 0.0),
        # Robots that do not know the way turn aside for walls ahead.
        ((9, -9), None, {"is_loaded": True, "sees_wall": FRONT}, ASIDE, HALF_RD),
        (None, None, {"sees_wall": BACK}, RANDOM, HALF_RD),
        # All turn aside for robots close ahead.
        ((9, 0), None, ROBOT_AHEAD, ASIDE, HALF_RD),
        ((9, 9), None, ROBOTS_BESIDE, np.pi / 4, HALF_RD),
        ((9, 9), None, ROBOTS_FAR_AWAY, np.pi / 4, HALF_RD),
    ],
)
def test_where_foragers_go(food, home, senses, turn, step):
    _, command = forage(food, home, senses)
    turns = np.asarray(command.turn)
    np.testing.assert_allclose(command.forward, step, atol=1e-5)

    if turn == RANDOM:
        assert np.radians(20) < np.abs(turns).max() <= np.radians(25)
        assert 0.2 < (turns > 0).mean() < 0.8
    elif turn == ASIDE:
        np.testing.assert_allclose(np.abs(turns), QUARTER, rtol=1e-6)
        assert 0.2 < (turns > 0).mean() < 0.8
    else:
        np.testing.assert_allclose(turns, turn, atol=1e-6)


@pytest.mark.parametrize(
    ("food", "home", "senses", "name", "place"),
    [
        (None, None, ITEM, "food", (1.2, 0.5)),
        ((9, 9), (0, 9), {}, "food", (9, 9)),
        ((9, 9), (0, 9), {}, "home", (0, 9)),
        (None, None, {"on_dump": True, "is_loaded": True}, "home", (0, 0)),
    ],
)
def test_remembered_places_stay_as_foragers_move(food, home, senses, name, place):
    """`place` is where food or home lies in the robot's frame before the step."""
    memory, command = forage(food, home, senses)
    assert memory[name].known[0]
    walked = np.array([command.forward[0], 0.0])
    remembered = turned(memory[name].vector[0] + walked, command.turn[0])
    np.testing.assert_allclose(remembered, place, atol=1e-5)


def test_items_that_cannot_be_lifted_are_forgotten():
    memory, _ = forage((9, 9), (0, 9), ITEM | {"grasp_failed": True})
    assert not memory["food"].known.any()


def forage(food, home, senses, n_robots=40):
    """Return memories and commands of foragers after a step.

    Args:
        food: vector to food that they know, None for none [mm].
        home: vector to home that they know, None for none [mm].
        senses: what all of them sense, by names of `Observation`.
        n_robots: number of robots, which differ only in their random numbers.
    """
    observation = senses_nothing(n_robots)
    for name, value in senses.items():
        sensed = np.array([value] * n_robots, getattr(observation, name).dtype)
        observation = observation._replace(**{name: sensed})
    memory = {
        "food": remember([food or (0, 0)] * n_robots, known=food is not None),
        "home": remember([home or (0, 0)] * n_robots, known=home is not None),
    }
    forager = replace(Forager(), reach=REACH)
    return forager.act(memory, observation, jax.random.key(2))


def test_points_are_spread_evenly_over_a_ring():
    """Half of all points lie within the circle that halves the area of the ring."""
    inner = 3.0
    outer = 9.0
    points = draw_in_ring((inner, outer), 20_000, jax.random.key(0))
    distance = length(np.asarray(points))
    assert distance.min() >= inner - 1e-5
    assert distance.max() <= outer + 1e-5
    halving = np.sqrt((inner**2 + outer**2) / 2)
    np.testing.assert_allclose(np.mean(distance < halving), 0.5, atol=0.02)
