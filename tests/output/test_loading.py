"""A run read back: on every engine its tables hold what happened."""

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


def cleaned(run, out):
    """Clean, and return all records (T, W, ...), the start included."""
    records, advance = [run.start], run.advance

    def advance_and_keep():
        records.append(advance())
        return records[-1]

    run.advance = advance_and_keep
    run_swarm(run, out)
    return jax.tree.map(lambda *parts: np.concatenate(parts), *records)


def array(table, name, shape):
    """A column as (T, N), not a number where it is null."""
    return np.array(table[name].to_pylist(), float).reshape(shape)


@pytest.fixture(scope="module", params=["planar", "warp", pytest.param("mjx", marks=pytest.mark.slow)])
def done(request, tmp_path_factory):
    """A run of three worlds of which 2 and 0 are recorded, its records, and what was read back."""
    out = tmp_path_factory.mktemp("run")
    engine = ENGINES.get(request.param, PlanarSettings(1))
    run = tiny_run(engine, steps=25)
    records = cleaned(run, out)
    return run, records, iswarm_mj.load(out), out


class TestEveryEngine:
    def test_what_the_run_was(self, done):
        run, _, saved, _ = done
        assert (saved.config, saved.genome) == (run.config, run.genome)
        assert saved.settings == replace(run.settings, record_worlds=(0, 2), stop_at=None)
        assert saved.result.items() >= run.identity.items() and saved.result["version"] == iswarm_mj.__version__
        assert saved.result["picked"] == [run.measures(world).picked for world in range(3)]
        assert list(saved.scenes) == [0, 2] and saved.scene.world == 0 and saved.scene.control_period == 1.0

    def test_robots(self, done):
        run, records, saved, _ = done
        assert saved.robots.num_rows == 2 * 26 * N
        for place, world in enumerate((2, 0)):
            table, shape = of_world(saved.robots, world), (26, N)
            record = jax.tree.map(lambda a, place=place: a[:, place], records)
            np.testing.assert_array_equal(array(table, "step", shape).T, [np.arange(26)] * N)
            np.testing.assert_array_equal(array(table, "robot", shape), [np.arange(N)] * 26)
            found = np.stack([array(table, name, shape) for name in ("x", "y", "yaw")], axis=-1)
            np.testing.assert_allclose(found, record.poses * [1e-3, 1e-3, 1], atol=1e-5, rtol=1e-5)
            np.testing.assert_allclose(found[-1, :, :2], 1e-3 * poses(run)[world][:, :2], atol=1e-7)
            for name in ("dust", "dump"):
                memory = getattr(record.swarm.memory, name)
                hops = np.where(memory.known, memory.hop, np.nan)
                np.testing.assert_array_equal(array(table, f"{name}_hop", shape), hops)
                assert np.nanmax(hops) > 2
                for axis, part in enumerate("xy"):
                    vector = np.where(memory.known, 1e-3 * memory.vector[..., axis], np.nan)
                    np.testing.assert_allclose(array(table, f"{name}_{part}", shape), vector, atol=1e-7)
            for name in ("turn", "forward"):
                wanted = getattr(record.command, name)[1:] * (1 if name == "turn" else 1e-3)
                np.testing.assert_allclose(array(table, name, shape)[1:], wanted, atol=1e-6)
                assert np.isnan(array(table, name, shape)[0]).all()
            for name in ("dust", "dump"):
                hops = array(table, f"{name}_hop", shape)[:-1]  # said in the next step, up to 14
                np.testing.assert_array_equal(
                    array(table, f"said_{name}_hop", shape)[1:], np.where(hops <= 14, hops, np.nan)
                )
            np.testing.assert_array_equal(array(table, "is_scout", shape), record.swarm.memory.is_scout)
            assert array(table, "is_loaded", shape).any() and array(table, "is_alive", shape).all()

    def test_links(self, done):
        _, records, saved, _ = done
        for place, world in enumerate((2, 0)):
            table = of_world(saved.links, world)
            links = jax.tree.map(lambda a, place=place: a[:, place], records.links)
            step, receiver, side = np.nonzero(links.valid)
            assert len(step) == table.num_rows > 300
            for name, wanted in (("step", step), ("receiver", receiver), ("side", side)):
                np.testing.assert_array_equal(table[name], wanted)
            for name in ("sender", "led"):
                np.testing.assert_array_equal(table[name], getattr(links, name)[links.valid])
            np.testing.assert_allclose(table["bearing"], links.measured_bearing[links.valid], rtol=1e-6)
            np.testing.assert_allclose(table["distance"], 1e-3 * links.true_distance[links.valid], rtol=1e-4)
            measured = 1e-3 * records.measured_distance[:, place][links.valid]
            np.testing.assert_allclose(table["measured_distance"], measured, rtol=1e-6)
            error = table["measured_distance"].to_numpy() / table["distance"].to_numpy()
            assert error.mean() == pytest.approx(1, abs=0.03) and error.std() == pytest.approx(0.1, abs=0.02)
            heard = table["is_heard"].to_numpy()
            np.testing.assert_array_equal(heard, records.is_heard[:, place][links.valid])
            assert heard.mean() == pytest.approx(0.9 * 0.9, abs=0.08)

    def test_balls_and_steps(self, done):
        _, records, saved, _ = done
        for place, world in enumerate((2, 0)):
            balls, table = (
                jax.tree.map(lambda a, place=place: a[:, place], records.swarm.task),
                of_world(saved.balls, world),
            )
            state = np.where(balls.is_held, "held", np.where(balls.is_delivered, "delivered", "lying"))
            assert table["state"].to_pylist() == state.ravel().tolist()
            holder = np.where(balls.is_held, balls.holder, np.nan)
            np.testing.assert_array_equal(array(table, "holder", holder.shape), holder)
            found = np.stack([array(table, name, holder.shape) for name in "xyz"], axis=-1)
            np.testing.assert_allclose(found, 1e-3 * centres(records)[:, place], atol=1e-7)
            np.testing.assert_allclose(array(table, "radius", holder.shape), balls.radius, rtol=1e-6)
            steps = of_world(saved.steps, world)
            np.testing.assert_allclose(steps["mean_speed"], 1e-3 * records.speed[:, place], rtol=1e-5)
            assert steps["time"].to_pylist() == list(range(26)) and all(steps["is_running"].to_pylist())
            last = {name: steps[name][-1].as_py() for name in ("picked", "delivered", "collisions")}
            assert last == {name: saved.result[name][world] for name in last}
        assert "held" in saved.balls["state"].to_pylist()
