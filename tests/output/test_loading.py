"""A run that is loaded: on every engine its tables hold what happened."""

from dataclasses import replace

import jax
import numpy as np
import pytest
from support.mjx import ENGINES, N, poses, tiny_run
from support.recorded import of_world
from support.worlds import centres

import iswarm_mj
from iswarm_mj import PlanarSettings
from iswarm_mj.workflows.clean import run_swarm

STEPS = 25
SHAPE = (1 + STEPS, N)
"""Shape of the columns of a world's robots."""
RECORDED = (2, 0)
"""Recorded worlds, in the order of the records."""
LONGEST_SENT_HOP = 14


def run_and_keep(run, out):
    """Clean, and return all records (T, W, ...), the start included."""
    records = [run.start]
    advance = run.advance

    def advance_and_keep():
        records.append(advance())
        return records[-1]

    run.advance = advance_and_keep
    run_swarm(run, out)
    return jax.tree.map(lambda *parts: np.concatenate(parts), *records)


def array(table, name, shape=SHAPE):
    """A column in a shape, not a number where it is null."""
    return np.array(table[name].to_pylist(), float).reshape(shape)


@pytest.fixture(
    scope="module",
    params=["planar", *(pytest.param(name, marks=pytest.mark.slow) for name in ("warp", "mjx"))],
)
def done(request, tmp_path_factory):
    """A run of three worlds of which 2 and 0 are recorded, its records, and the loaded run."""
    out = tmp_path_factory.mktemp("run")
    engine = ENGINES.get(request.param, PlanarSettings(1))
    run = tiny_run(engine, steps=STEPS)
    records = run_and_keep(run, out)
    return run, records, iswarm_mj.load(out)


@pytest.fixture(params=RECORDED)
def world(request):
    """Number of a recorded world."""
    return request.param


@pytest.fixture
def record(done, world):
    """Records of the world (T, ...)."""
    _, records, _ = done
    place = RECORDED.index(world)
    return jax.tree.map(lambda values: values[:, place], records)


def test_the_run_is_described(done):
    run, _, loaded = done
    assert (loaded.config, loaded.genome) == (run.config, run.genome)
    assert loaded.settings == replace(run.settings, record_worlds=(0, 2), stop_at=None)
    assert loaded.result.items() >= run.identity.items()
    assert loaded.result["version"] == iswarm_mj.__version__
    assert loaded.result["picked"] == [run.measures(world).picked for world in range(3)]
    assert list(loaded.scenes) == [0, 2]
    assert loaded.scene.world == 0 and loaded.scene.control_period == 1.0


class TestRobots:
    @pytest.fixture
    def table(self, done, world):
        _, _, loaded = done
        return of_world(loaded.robots, world)

    def test_there_is_a_row_for_each_step_and_robot(self, done, table):
        _, _, loaded = done
        assert loaded.robots.num_rows == len(RECORDED) * (1 + STEPS) * N
        np.testing.assert_array_equal(array(table, "step").T, [np.arange(1 + STEPS)] * N)
        np.testing.assert_array_equal(array(table, "robot"), [np.arange(N)] * (1 + STEPS))

    def test_poses_are_in_metres(self, done, world, table, record):
        run, _, _ = done
        loaded_poses = np.stack([array(table, name) for name in ("x", "y", "yaw")], axis=-1)
        expected = record.poses * [1e-3, 1e-3, 1]
        np.testing.assert_allclose(loaded_poses, expected, atol=1e-5, rtol=1e-5)
        last = 1e-3 * poses(run)[world][:, :2]
        np.testing.assert_allclose(loaded_poses[-1, :, :2], last, atol=1e-7)

    @pytest.mark.parametrize("name", ["dust", "dump"])
    def test_vectors_are_null_where_unknown(self, table, record, name):
        memory = getattr(record.swarm.memory, name)
        hops = np.where(memory.known, memory.hop, np.nan)
        np.testing.assert_array_equal(array(table, f"{name}_hop"), hops)
        assert np.nanmax(hops) > 2
        for axis, part in enumerate("xy"):
            vector = np.where(memory.known, 1e-3 * memory.vector[..., axis], np.nan)
            np.testing.assert_allclose(array(table, f"{name}_{part}"), vector, atol=1e-7)

    @pytest.mark.parametrize("name", ["dust", "dump"])
    def test_hop_counts_are_sent_in_the_next_step(self, table, name):
        remembered = array(table, f"{name}_hop")[:-1]
        sent = np.where(remembered <= LONGEST_SENT_HOP, remembered, np.nan)
        np.testing.assert_array_equal(array(table, f"said_{name}_hop")[1:], sent)

    @pytest.mark.parametrize(("name", "unit"), [("turn", 1), ("forward", 1e-3)])
    def test_commands_are_those_of_the_drive(self, table, record, name, unit):
        values = array(table, name)
        expected = getattr(record.command, name)[1:] * unit
        np.testing.assert_allclose(values[1:], expected, atol=1e-6)
        assert np.isnan(values[0]).all()  # nothing is commanded before the start

    def test_scouts_and_states_are_those_of_the_robots(self, table, record):
        np.testing.assert_array_equal(array(table, "is_scout"), record.swarm.memory.is_scout)
        assert array(table, "is_loaded").any() and array(table, "is_alive").all()


class TestLinks:
    @pytest.fixture
    def table(self, done, world):
        _, _, loaded = done
        return of_world(loaded.links, world)

    def test_rows_are_valid_links(self, table, record):
        links = record.links
        step, receiver, side = np.nonzero(links.valid)
        assert len(step) == table.num_rows > 300
        for name, numbers in (("step", step), ("receiver", receiver), ("side", side)):
            np.testing.assert_array_equal(table[name], numbers)
        for name in ("sender", "led"):
            np.testing.assert_array_equal(table[name], getattr(links, name)[links.valid])

    def test_bearings_and_distances_are_those_of_the_record(self, table, record):
        links = record.links
        bearing = links.measured_bearing[links.valid]
        np.testing.assert_allclose(table["bearing"], bearing, rtol=1e-6)
        distance = 1e-3 * links.true_distance[links.valid]
        np.testing.assert_allclose(table["distance"], distance, rtol=1e-4)
        measured = 1e-3 * record.measured_distance[links.valid]
        np.testing.assert_allclose(table["measured_distance"], measured, rtol=1e-6)

    def test_distances_are_measured_with_noise(self, table):
        error = table["measured_distance"].to_numpy() / table["distance"].to_numpy()
        assert error.mean() == pytest.approx(1, abs=0.03)
        assert error.std() == pytest.approx(0.1, abs=0.02)

    def test_some_messages_are_damaged(self, table, record):
        is_heard = table["is_heard"].to_numpy()
        np.testing.assert_array_equal(is_heard, record.is_heard[record.links.valid])
        assert is_heard.mean() == pytest.approx(0.9 * 0.9, abs=0.08)


class TestBallsAndSteps:
    def test_balls_have_their_states_and_holders(self, done, world, record):
        _, _, loaded = done
        table = of_world(loaded.balls, world)
        balls = record.swarm.task
        on_floor = np.where(balls.is_delivered, "delivered", "lying")
        states = np.where(balls.is_held, "held", on_floor)
        assert table["state"].to_pylist() == states.ravel().tolist()
        holder = np.where(balls.is_held, balls.holder, np.nan)
        np.testing.assert_array_equal(array(table, "holder", holder.shape), holder)
        assert "held" in loaded.balls["state"].to_pylist()

    def test_balls_are_in_metres(self, done, world, record):
        _, records, loaded = done
        table = of_world(loaded.balls, world)
        radius = record.swarm.task.radius
        positions = np.stack([array(table, name, radius.shape) for name in "xyz"], axis=-1)
        expected = 1e-3 * centres(records)[:, RECORDED.index(world)]
        np.testing.assert_allclose(positions, expected, atol=1e-7)
        np.testing.assert_allclose(array(table, "radius", radius.shape), radius, rtol=1e-6)

    def test_steps_have_times_speeds_and_counts(self, done, world, record):
        _, _, loaded = done
        steps = of_world(loaded.steps, world)
        np.testing.assert_allclose(steps["mean_speed"], 1e-3 * record.speed, rtol=1e-5)
        assert steps["time"].to_pylist() == list(range(1 + STEPS))
        assert all(steps["is_running"].to_pylist())
        for name in ("picked", "delivered", "collisions"):
            assert steps[name][-1].as_py() == loaded.result[name][world]
