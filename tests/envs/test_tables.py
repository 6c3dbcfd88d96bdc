"""What robots observe and do: the tables of the page are those of the code; nothing leaks that was not heard."""

from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from support.envs import SMALL
from support.sensing import senses_nothing
from support.tasks import Eastward

from iswarm_mj import PlanarSettings, make_env
from iswarm_mj.config.swarm import SwarmConfig
from iswarm_mj.engines.arena import read_robot
from iswarm_mj.envs import tables
from iswarm_mj.sensors.fields import Bearing, Flag, Integer, Real, Vector
from iswarm_mj.sensors.memory import VectorMemory
from iswarm_mj.sensors.messages import Message, Payload
from iswarm_mj.tasks.base import Quantity

FIELDS = {"flag": Flag(), "count": Integer(4, low=-3), "heat": Real(0, 1, 5, unit="K"), "aim": Bearing(3)}
PAYLOAD = Payload({**FIELDS, "home": Vector(28.3, 4, 4, 2)})
ROBOT = read_robot()
TABLE = tables.observation_rows(SwarmConfig(), ROBOT, PAYLOAD, {"light": (Quantity("brightness", "lx", 0, 9), 1)})
PAGE = (Path(__file__).parents[2] / "docs" / "environments.md").read_text()


def of_page(heading):
    """Cells of the rows of the table under a heading."""
    part = PAGE.split(f"## {heading}\n")[1].split("\n## ")[0]
    rows = [line.strip("| ").split("|") for line in part.splitlines() if line.startswith("|")]
    return [[cell.strip() for cell in row] for row in rows[2:]]


def as_page(table):
    def number(value):
        return {round(np.pi, 4): "π", round(-np.pi, 4): "-π"}.get(round(float(value), 4), f"{value:.3g}")

    return [[f"`{r.name}`", str(r.size), r.unit, number(r.low), number(r.high), r.description] for r in table]


def test_observations_of_the_page_are_those_of_the_code():
    assert of_page("Observations") == as_page(tables.observation_rows(SwarmConfig(), ROBOT, PAYLOAD, {}))


def test_actions_of_the_page_are_those_of_the_code():
    found = [[name, size, text] for name, size, _, _, _, text in as_page(tables.action_rows(SwarmConfig(), PAYLOAD))]
    assert of_page("Actions") == found


def heard(seed, is_heard):
    """An observation with random content, heard or not."""
    rng = np.random.default_rng(seed)
    n, s = is_heard.shape
    numbers = jnp.asarray(rng.uniform(-9, 9, (n, s)), jnp.float32)
    values = {
        "flag": numbers > 0,
        "count": numbers.astype(jnp.int32),
        "heat": abs(numbers) / 9,
        "aim": numbers / 3,
        "home": VectorMemory(jnp.stack([numbers, 1 - numbers], -1), abs(numbers).astype(jnp.int32) % 3, numbers > 1),
    }
    seen = senses_nothing(n)._replace(is_heard=jnp.asarray(is_heard), bearing=numbers, distance=abs(numbers) + 2)
    led = jnp.asarray(rng.integers(0, 4, (n, s)))
    return seen._replace(payload=values, led=led, sensed={"light": numbers[:, 0]}, ball_vector=numbers[:, :2] / 3)


def test_rows_are_what_was_sensed():
    """Within their bounds; nothing of what was not heard, or of a ball that is not there."""
    rng, flags = np.random.default_rng(4), ("at_dust", "on_dump", "is_loaded", "grasp_failed", "waits")
    is_heard, sees_wall = rng.random((2, 9, 4)) < 0.7
    seen = heard(2, is_heard)._replace(**{name: rng.random(9) < 0.5 for name in flags}, sees_wall=sees_wall)
    home, ball = seen.payload["home"], np.clip(np.asarray(seen.ball_vector) / 2**1.5, -0.75, 0.75)
    of_sides = {
        "bearing": (np.asarray(seen.bearing) + np.pi) % (2 * np.pi) - np.pi,
        "distance": np.minimum(np.asarray(seen.distance) / 2**1.5, 7),
        "led": seen.led,
        "heard_flag": seen.payload["flag"],
        "heard_count": np.clip(seen.payload["count"], -3, 12),
        "heard_heat": seen.payload["heat"],
        "heard_aim": seen.payload["aim"],
        "heard_home_known": home.known,
        "heard_home_x": np.clip(home.vector[..., 0] / 2**1.5, -10, 10),
        "heard_home_y": np.clip(home.vector[..., 1] / 2**1.5, -10, 10),
        "heard_home_hop": home.hop,
    }
    expected = {name: np.where(is_heard, values, 0) for name, values in of_sides.items()}
    expected |= {"is_heard": is_heard, "sees_wall": sees_wall, "ball": np.where(seen.at_dust[:, None], ball, 0)}
    expected |= {name: getattr(seen, name) for name in flags} | {"light": np.maximum(seen.sensed["light"], 0)}
    split = tables.split(TABLE, np.asarray(tables.encode(TABLE, seen)))
    assert list(split) == [row.name for row in TABLE] and split.keys() == expected.keys()
    for name, values in split.items():
        np.testing.assert_allclose(values, np.reshape(expected[name], (9, -1)), atol=1e-5, err_msg=name)


def test_actions_mean_what_the_table_says():
    action = np.ones((4, sum(row.size for row in tables.action_rows(SMALL, PAYLOAD))), np.float32)
    action[1], action[2] = -7.0, 0.0  # the first of which is clipped
    action[3] = 0.5, -0.25, -0.1, 0.3, -0.5, 0.25, 0.1, -0.5, 0.25, 0.6
    command, said, is_bad = tables.decode(tables.action_rows(SMALL, PAYLOAD), jnp.asarray(action))
    np.testing.assert_allclose(command.turn, np.pi / 2 * np.array([1, -1, 0, 0.5]), rtol=1e-6)
    np.testing.assert_allclose(command.forward, 2**0.5 * np.array([1, -1, 0, -0.25]), rtol=1e-5)
    np.testing.assert_array_equal(said["flag"], [True, False, False, False])
    np.testing.assert_array_equal(said["count"], [12, -3, 5, 7])
    np.testing.assert_allclose(said["heat"], [1, 0, 0.5, 0.25])
    np.testing.assert_allclose(said["aim"], np.pi * np.array([1, -1, 0, 0.25]), rtol=1e-6)
    np.testing.assert_allclose(
        said["home"].vector, 28.3 * np.array([(1, 1), (-1, -1), (0, 0), (-0.5, 0.25)]), rtol=1e-6
    )
    np.testing.assert_array_equal(said["home"].hop, [2, 0, 1, 2])
    np.testing.assert_array_equal(said["home"].known, [True, False, False, True])
    assert not is_bad.any()
    shapes = jax.tree.map(lambda a: (a.shape, a.dtype), PAYLOAD.shapes(4))
    assert jax.tree.map(lambda a: (a.shape, a.dtype), said) == shapes


def test_actions_that_are_no_numbers_are_named_and_do_nothing():
    action = np.ones((3, 2), np.float32)
    action[1:, 1] = np.nan, np.inf
    command, _, is_bad = tables.decode(tables.action_rows(SMALL, Payload()), jnp.asarray(action))
    np.testing.assert_array_equal(is_bad, [False, True, True])
    assert np.isfinite(command.turn).all() and command.turn[1] == 0


def test_silence_is_sent():
    message, _ = PAYLOAD.unpack(PAYLOAD.pack(Message(jnp.zeros(2, int), tables.silence(PAYLOAD, 2))))
    assert not message.payload["home"].known.any() and not message.payload["flag"].any()
    np.testing.assert_array_equal(message.payload["count"], 0)


def test_tasks_add_what_they_let_robots_sense():
    """A line to the east: robots sense how far away it is, and are rewarded beyond it."""
    env = make_env(config=SMALL, task=Eastward(3.0), robots=8, engine=PlanarSettings(1), worlds=2, n_starts=3)
    assert env.observations[-1].name == "gap" and env.observations[-1].unit == "mm"
    state = env.reset(jax.random.split(jax.random.key(0), 2))
    for seed in range(3):
        x = np.asarray(state.data.world.bodies.poses)[..., 0]
        np.testing.assert_allclose(env.named(np.asarray(state.obs))["gap"][..., 0], 3.0 - x, atol=1e-4)
        np.testing.assert_allclose(state.metrics["share"], (x > 3).mean(axis=1))
        np.testing.assert_array_equal(state.metrics["steps"], seed + 1)
        state = env.step(state, np.random.default_rng(seed).uniform(-1, 1, (2, 8, 2)))
        after = np.asarray(state.data.world.bodies.poses)[..., 0]
        np.testing.assert_array_equal(state.reward, after > 3)
