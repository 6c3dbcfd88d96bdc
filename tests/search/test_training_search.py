"""The search of weights: its worlds, its curve, its files, which weights are kept, and that no
interruption changes a byte."""

import json
from dataclasses import dataclass, field, replace

import jax
import jax.numpy as jnp
import numpy as np
import pyarrow.csv
import pytest
from support.robots import robot_file, two_kinds
from support.search import contents
from support.training import GOAL, SMALL, TRAINING, Three, pretend, trained

from iswarm_mj.engines.arena import read_robot
from iswarm_mj.engines.mujoco.settings import MujocoSettings
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.engines.robot_file import read_robots
from iswarm_mj.search import training
from iswarm_mj.search.training import CHECKPOINT, CURVE, WEIGHTS, policy, train
from iswarm_mj.strategy.network import load_weights
from iswarm_mj.strategy.neural import N_WEIGHTS, Neural
from iswarm_mj.tasks.aggregation import Aggregation
from iswarm_mj.tasks.cleaning import CLEANING, Cleaning
from iswarm_mj.tasks.rewarded import REWARD
from iswarm_mj.utils.errors import SimulationFault, UserError
from iswarm_mj.workflows.rollout import Rollout

pytestmark = pytest.mark.usefixtures("few_pixels")
PLANAR = PlanarSettings(1)


@pytest.fixture
def out(tmp_path):
    return tmp_path / "out"


@pytest.fixture
def watched(monkeypatch):
    """Scenarios, weights and data of the keys of rollouts, which are pretended; results may be
    changed."""
    pretend(monkeypatch)
    pretended, seen = training.rollout, []

    def rollout(scenario, **options):
        keys = np.array([jax.random.key_data(world.key) for world in scenario.worlds])
        seen.append((scenario, np.asarray(scenario.strategy.weights), keys))
        return rollout.change(pretended(scenario, **options), len(keys))

    rollout.change = lambda found, n_worlds: found
    monkeypatch.setattr(training, "rollout", rollout)
    return seen, rollout


def curve(out):
    return pyarrow.csv.read_csv(out / CURVE).to_pylist()


def test_tasks_without_a_fitness_are_trained_by_their_rewards(monkeypatch, out):
    """The search comes near the goal."""

    def rollout(scenario, **_):
        assert isinstance(scenario.task, Aggregation) and REWARD in scenario.task.measured
        earned = 10 - np.abs(np.asarray(scenario.strategy.weights) - GOAL).sum(axis=1)
        none = np.zeros(scenario.n_worlds)
        return Rollout(
            none,
            none,
            none,
            none,
            none > 1,
            none,
            none,
            np.zeros((len(none), 1)),
            None,
            [],
            {REWARD: earned},
        )

    monkeypatch.setattr(training, "rollout", rollout)
    wanted = replace(TRAINING, generations=60, population=8, spread=0.3)
    assert (
        np.abs(train(wanted, Three(jnp.zeros(3)), out, PLANAR, task=Aggregation()) - GOAL).max()
        < 0.05
    )


def test_candidates_of_a_generation_meet_the_same_worlds_and_those_of_others_do_not(
    watched, tmp_path
):
    """Nor do those of another seed."""
    found = []
    for seed in (3, 4):
        watched[0].clear()
        trained(tmp_path / str(seed), replace(TRAINING, seed=seed))
        data = np.array([keys for _, _, keys in watched[0]]).reshape(5, 4, 2, 2)
        assert (data == data[:, :1]).all()
        weights = np.array([weights for _, weights, *_ in watched[0]]).reshape(5, 4, 2, 3)
        assert (weights == weights[:, :, :1]).all() and len(
            np.unique(weights.reshape(-1, 3), axis=0)
        ) == 20
        found.append((data[:, 0].reshape(-1, 2), weights))
    assert len(np.unique(np.concatenate([data for data, _ in found]), axis=0)) == 20
    assert (found[0][1] != found[1][1]).all()


def test_worlds_of_their_own_choose_the_weights(watched, out):
    """After each tenth generation; here the mean of generation 20 did better there than that of
    30."""
    seen, rollout = watched
    tried = []

    def change(found, n_worlds):
        if n_worlds != 7:
            return found
        tried.append((seen[-1][1][0], seen[-1][2]))
        return found._replace(picked=np.full(7, {1: 100, 2: 90_000, 3: 500}[len(tried)]))

    rollout.change = change
    wanted = replace(TRAINING, generations=33, validation=7)
    found = trained(out, wanted)
    np.testing.assert_array_equal(found, tried[1][0])
    assert (
        all((keys == tried[0][1]).all() for _, keys in tried)
        and len(np.unique(tried[0][1], axis=0)) == 7
    )
    rows = curve(out)
    assert [row["generation"] for row in rows if row["validation"] is not None] == [10, 20, 30]
    assert rows[19]["validation"] > rows[29]["validation"]
    np.testing.assert_array_equal(trained(out, wanted), found)


def test_points_that_are_no_numbers_are_refused(watched, out):
    watched[1].change = lambda found, n_worlds: found._replace(picked=np.full(n_worlds, np.nan))
    with pytest.raises(UserError, match="rewards of Cleaning are nan in a world"):
        trained(out)


def test_worlds_of_a_candidate_have_the_numbers_of_robots_and_the_arenas_in_turn(watched, out):
    """Each is judged by its own; what was not finished has no step in which it was."""
    judged = []

    class Judging(Cleaning):
        def fitness(self, measures, config, n_robots, steps):
            judged.append((config.arena.size, n_robots, steps, measures.finished_at))
            return 0.0

    watched[1].change = lambda found, n_worlds: found._replace(finished_at=np.tile([0, 7], 4))
    wanted = replace(TRAINING, robots=(4, 9), sizes=(15.0, 30.0), steps=60, generations=1)
    train(wanted, Three(jnp.zeros(3)), out, PLANAR, task=Judging())
    (one, _, keys), (other, _, same) = watched[0]
    assert (one.config.arena.size, other.config.arena.size) == (15, 30) and (keys == same).all()
    assert [world.n_robots for world in one.worlds] == 4 * [4, 9]
    assert [world.n_robots for world in other.worlds] == 4 * [16, 36]
    assert judged == 4 * [(15, 4, 60, None), (15, 9, 60, 7)] + 4 * [
        (30, 16, 60, None),
        (30, 36, 60, 7),
    ]


def test_the_curve_by_hand(monkeypatch, out):
    """One generation of 4 candidates with 2 worlds in 2 arenas; points are 20 for what was picked
    up, 20 for what was delivered and 40 for the mean progress; the last world of the second arena
    is at fault."""
    asked = []

    def rollout(scenario, **_):
        asked.append(np.asarray(scenario.strategy.weights)[::2])
        first, none = scenario.config.arena.size == 15, np.zeros(8)
        picked = np.array([1, 4, 6, 0, 2, 2, 5, 3]) + (0 if first else 4)
        delivered, collisions = picked // 2, np.arange(8) * (1 if first else 3)
        progress, faults = (
            np.stack([0 * delivered, delivered], axis=1),
            [] if first else [SimulationFault(world=7)],
        )
        return Rollout(
            delivered, picked, collisions, none, none > 1, none, none, progress, None, faults, {}
        )

    monkeypatch.setattr(training, "rollout", rollout)
    trained(out, replace(TRAINING, sizes=(15.0, 30.0), generations=1))
    (row,) = curve(out)
    picked = np.array([[1, 4, 6, 0, 2, 2, 5, 3], [5, 8, 10, 4, 6, 6, 9, 7]])
    collisions, robots = np.array([np.arange(8), 3 * np.arange(8)]), np.array([[4], [16]])
    worth = (
        (20 * picked + 40 * (picked // 2) - 0.05 * collisions / robots)
        .reshape(2, 4, 2)
        .mean(axis=(0, 2))
    )
    expected = {
        "generation": 1,
        **{"best": worth.max(), "mean": worth.mean(), "worst": worth.min()},
        **{
            "picked": picked.mean(),
            "delivered": (picked // 2).mean(),
            "collisions": collisions.mean(),
        },
        **{
            "faults": 1 / 16,
            "validation": None,
            "spread": asked[0].astype(float).std(axis=0).mean(),
        },
    }
    assert list(row) == list(expected) and row.pop("validation") is expected.pop("validation")
    assert row == pytest.approx(expected, rel=1e-5)


def test_the_robot_is_that_of_the_file_or_files(watched, tmp_path, out):
    """In the worlds, in the strategy, and as a setting that a training is resumed with."""
    path, kinds = robot_file(tmp_path, "five"), two_kinds(tmp_path, 4)
    trained(out, robot_file=path)
    assert [scenario.robot_file for scenario, *_ in watched[0]] == 5 * [path]
    assert policy(Neural(), SMALL, 4, path).robot == read_robot(path)
    assert policy(Neural(), SMALL, 4, kinds).robot == read_robots(kinds)
    with pytest.raises(UserError, match=r"different settings \(.*robot"):
        trained(out, robot_file=None)
    with pytest.raises(
        UserError, match=r"n_robots must be as many as the kinds .* have together, 5 \(got 4\)"
    ):
        trained(out, robot_file=two_kinds(tmp_path, 5), again=True)


def test_the_strategy_is_made_for_the_most_robots(watched, out):
    """Its weights need not pass through `__init__`, since those of many worlds may have a shape
    that it refuses."""
    asked = []

    @dataclass
    class Counted(Three):
        weights: object = field(init=False)

        def __post_init__(self):
            self.weights = jnp.zeros(3)

        def for_world(self, config, robot, n_robots):
            asked.append(n_robots)
            return self

    train(replace(TRAINING, robots=(4, 9), generations=1), Counted(), out, PLANAR, task=CLEANING)
    assert asked == [9] and watched[0][0][1].shape == (8, 3)


def test_a_tree_of_weights(monkeypatch, out):
    """Comes back as a tree, and from the file."""
    pretend(monkeypatch)
    pretended = training.rollout

    def rollout(scenario, **options):
        weights = scenario.strategy.weights
        flat = jnp.concatenate([weights["a"], weights["b"][:, 0]], axis=1)
        strategy = replace(scenario.strategy, weights=flat)
        return pretended(replace(scenario, strategy=strategy), **options)

    monkeypatch.setattr(training, "rollout", rollout)
    begins = {"a": jnp.zeros(1), "b": jnp.zeros((1, 2))}
    found = train(TRAINING, Three(begins), out, PLANAR, task=CLEANING)
    assert jax.tree.map(jnp.shape, found) == jax.tree.map(jnp.shape, begins)
    jax.tree.map(np.testing.assert_array_equal, load_weights(out / WEIGHTS, begins), found)
    with pytest.raises(UserError, match="has 3 weights, but 4 are wanted"):
        load_weights(out / WEIGHTS, jnp.zeros((2, 2)))


def test_files_which_no_interruption_changes(monkeypatch, tmp_path):
    pretend(monkeypatch)
    found = trained(tmp_path / "whole")
    whole = contents(tmp_path / "whole")
    assert sorted(whole) == sorted([CHECKPOINT, CURVE, WEIGHTS, "learning.png", "learning.svg"])
    np.testing.assert_array_equal(load_weights(tmp_path / "whole" / WEIGHTS), found)
    assert found.any()  # the last mean, as long as there was no validation
    assert [row["generation"] for row in curve(tmp_path / "whole")] == [1, 2, 3, 4, 5]
    settings = json.loads(whole[CHECKPOINT][-1][1])["settings"]
    assert (settings["engine"], settings["population"], settings["strategy"]["class"]) == (
        "planar",
        4,
        "Three",
    )
    for broken in (0, 1, 3):
        out = tmp_path / f"broken{broken}"
        with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
            pretend(patch, breaks_after=broken)
            trained(out)
        assert (out / CURVE).exists() == (out / WEIGHTS).exists() == bool(broken)
        asked = pretend(monkeypatch)
        trained(out)
        assert len(asked) == 5 - broken and contents(out) == whole
    longer = replace(TRAINING, generations=7)
    trained(tmp_path / "long", longer)
    asked.clear()
    trained(tmp_path / "whole", longer)
    assert len(asked) == 2 and contents(tmp_path / "whole") == contents(tmp_path / "long")


def test_what_is_in_the_way_is_refused(monkeypatch, tmp_path):
    pretend(monkeypatch)
    trained(tmp_path)
    before = contents(tmp_path)
    for match, wanted, weights, engine, task in (
        (r"different settings \(.*task", TRAINING, [0, 0, 0], PLANAR, Aggregation()),
        (r"different settings \(.*seed", replace(TRAINING, seed=4), [0, 0, 0], PLANAR, CLEANING),
        ("different settings", TRAINING, [0, 0, 0], MujocoSettings(1), CLEANING),
        ("different settings", TRAINING, [0, 1, 0], PLANAR, CLEANING),
        (
            "generations must be at least 5, which",
            replace(TRAINING, generations=4),
            [0, 0, 0],
            PLANAR,
            CLEANING,
        ),
    ):
        with pytest.raises(UserError, match=match):
            train(wanted, Three(jnp.array(weights, float)), tmp_path, engine, task=task)
        assert contents(tmp_path) == before
    assert len(trained(tmp_path, again=True)) == 3
    assert len(policy(Neural(), SMALL, 4).weights) == N_WEIGHTS
    with pytest.raises(UserError, match=r"has 3 weights, but"):
        policy(Neural(tmp_path / WEIGHTS), SMALL, 4)
