"""Tables of observations and actions: as on the page, and as robots sense and act."""

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
from iswarm_mj.envs.tables import (
    action_rows,
    decode_action,
    encode_observation,
    observation_rows,
    silence,
    split,
)
from iswarm_mj.sensors.fields import Bearing, Flag, Integer, Real, Vector
from iswarm_mj.sensors.memory import VectorMemory
from iswarm_mj.sensors.messages import Message, Payload
from iswarm_mj.tasks.base import Quantity
from iswarm_mj.utils.units import RD

VECTOR_RANGE = 28.3
"""Longest vector of a message [mm], 10 rd."""
PAYLOAD = Payload(
    {
        "flag": Flag(),
        "count": Integer(4, low=-3),
        "heat": Real(0, 1, 5, unit="K"),
        "aim": Bearing(3),
        "home": Vector(VECTOR_RANGE, 4, 4, 2),
    }
)
ROBOT = read_robot()
ROWS = observation_rows(
    SwarmConfig(), ROBOT, PAYLOAD, {"light": (Quantity("brightness", "lx", 0, 9), 1)}
)
PAGE = (Path(__file__).parents[2] / "docs" / "environments.md").read_text()


class TestPage:
    """The tables of docs/environments.md, which are of the payload above."""

    @staticmethod
    def cells_under(heading):
        """Return the cells of the rows of the table under a heading."""
        section = PAGE.split(f"## {heading}\n")[1].split("\n## ")[0]
        lines = [line for line in section.splitlines() if line.startswith("|")]
        rows = [line.strip("| ").split("|") for line in lines]
        header_rows = 2
        return [[cell.strip() for cell in row] for row in rows[header_rows:]]

    @staticmethod
    def number(value):
        """Return a bound as the page states it."""
        if np.isclose(abs(value), np.pi):
            return "π" if value > 0 else "-π"
        return f"{value:.3g}"

    def test_observations_are_those_of_the_code(self):
        rows = observation_rows(SwarmConfig(), ROBOT, PAYLOAD, {})
        assert self.cells_under("Observations") == [
            [
                f"`{row.name}`",
                str(row.size),
                row.unit,
                self.number(row.low),
                self.number(row.high),
                row.description,
            ]
            for row in rows
        ]

    def test_actions_are_those_of_the_code(self):
        rows = action_rows(SwarmConfig(), PAYLOAD)
        assert self.cells_under("Actions") == [
            [f"`{row.name}`", str(row.size), row.description] for row in rows
        ]


FLAGS = ("at_dust", "on_dump", "is_loaded", "grasp_failed", "waits")


def random_observation(seed, is_heard):
    """Return an observation with random content, heard or not."""
    rng = np.random.default_rng(seed)
    n_robots, n_sides = is_heard.shape
    numbers = jnp.asarray(rng.uniform(-9, 9, (n_robots, n_sides)), jnp.float32)
    led = jnp.asarray(rng.integers(0, 4, (n_robots, n_sides)))
    home = VectorMemory(
        vector=jnp.stack([numbers, 1 - numbers], -1),
        hop=abs(numbers).astype(jnp.int32) % 3,
        known=numbers > 1,
    )
    return senses_nothing(n_robots)._replace(
        is_heard=jnp.asarray(is_heard),
        bearing=numbers,
        distance=abs(numbers) + 2,
        led=led,
        payload={
            "flag": numbers > 0,
            "count": numbers.astype(jnp.int32),
            "heat": abs(numbers) / 9,
            "aim": numbers / 3,
            "home": home,
        },
        sensed={"light": numbers[:, 0]},
        ball_vector=numbers[:, :2] / 3,
    )


def test_rows_are_what_was_sensed():
    """Numbers keep within their bounds.

    There are none of what was not heard, or of a ball that is not there.
    """
    n_robots = 9
    n_sides = 4
    rng = np.random.default_rng(4)
    is_heard, sees_wall = rng.random((2, n_robots, n_sides)) < 0.7
    flags = {name: rng.random(n_robots) < 0.5 for name in FLAGS}
    seen = random_observation(2, is_heard)._replace(**flags, sees_wall=sees_wall)

    home = seen.payload["home"]
    x, y = np.moveaxis(np.asarray(home.vector), -1, 0) / RD
    of_sides = {
        "bearing": (np.asarray(seen.bearing) + np.pi) % (2 * np.pi) - np.pi,
        "distance": np.minimum(np.asarray(seen.distance) / RD, 7),
        "led": seen.led,
        "heard_flag": seen.payload["flag"],
        "heard_count": np.clip(seen.payload["count"], -3, 12),
        "heard_heat": seen.payload["heat"],
        "heard_aim": seen.payload["aim"],
        "heard_home_known": home.known,
        "heard_home_x": np.clip(x, -10, 10),
        "heard_home_y": np.clip(y, -10, 10),
        "heard_home_hop": home.hop,
    }
    expected = {name: np.where(is_heard, values, 0) for name, values in of_sides.items()}
    ball = np.clip(np.asarray(seen.ball_vector) / RD, -0.75, 0.75)
    expected |= flags
    expected["is_heard"] = is_heard
    expected["sees_wall"] = sees_wall
    expected["ball"] = np.where(flags["at_dust"][:, None], ball, 0)
    expected["light"] = np.maximum(seen.sensed["light"], 0)

    by_name = split(ROWS, np.asarray(encode_observation(ROWS, seen)))
    assert list(by_name) == [row.name for row in ROWS]
    assert by_name.keys() == expected.keys()
    for name, values in by_name.items():
        of_robots = np.reshape(expected[name], (n_robots, -1))
        np.testing.assert_allclose(values, of_robots, atol=1e-5, err_msg=name)


def test_actions_mean_what_the_table_says():
    """All numbers 1, all below -1, which are clipped, all 0, and any."""
    rows = action_rows(SMALL, PAYLOAD)
    action = np.ones((4, sum(row.size for row in rows)), np.float32)
    action[1] = -7.0
    action[2] = 0.0
    action[3] = 0.5, -0.25, -0.1, 0.3, -0.5, 0.25, 0.1, -0.5, 0.25, 0.6
    command, payload, is_bad = decode_action(rows, jnp.asarray(action))
    assert not is_bad.any()

    max_turn = np.pi / 2
    max_step = 0.5 * RD
    turn = max_turn * np.array([1, -1, 0, 0.5])
    forward = max_step * np.array([1, -1, 0, -0.25])
    np.testing.assert_allclose(command.turn, turn, rtol=1e-6)
    np.testing.assert_allclose(command.forward, forward, rtol=1e-5)

    np.testing.assert_array_equal(payload["flag"], [True, False, False, False])
    np.testing.assert_array_equal(payload["count"], [12, -3, 5, 7])
    np.testing.assert_allclose(payload["heat"], [1, 0, 0.5, 0.25])
    np.testing.assert_allclose(payload["aim"], np.pi * np.array([1, -1, 0, 0.25]), rtol=1e-6)
    vector = VECTOR_RANGE * np.array([(1, 1), (-1, -1), (0, 0), (-0.5, 0.25)])
    np.testing.assert_allclose(payload["home"].vector, vector, rtol=1e-6)
    np.testing.assert_array_equal(payload["home"].hop, [2, 0, 1, 2])
    np.testing.assert_array_equal(payload["home"].known, [True, False, False, True])

    shapes = jax.tree.map(lambda a: (a.shape, a.dtype), PAYLOAD.shapes(4))
    assert jax.tree.map(lambda a: (a.shape, a.dtype), payload) == shapes


def test_actions_that_are_not_finite_are_named_and_do_nothing():
    action = np.ones((3, 2), np.float32)
    action[1:, 1] = np.nan, np.inf
    command, _, is_bad = decode_action(action_rows(SMALL, Payload()), jnp.asarray(action))
    np.testing.assert_array_equal(is_bad, [False, True, True])
    assert np.isfinite(command.turn).all()
    assert command.turn[1] == 0


def test_silence_is_sent():
    sent = Message(jnp.zeros(2, int), silence(PAYLOAD, 2))
    message, _ = PAYLOAD.unpack(PAYLOAD.pack(sent))
    assert not message.payload["home"].known.any()
    assert not message.payload["flag"].any()
    np.testing.assert_array_equal(message.payload["count"], 0)


def test_tasks_add_what_they_let_robots_sense():
    """Robots sense how far a line to the east is, and are rewarded beyond it."""
    line = 3.0
    env = make_env(
        config=SMALL,
        task=Eastward(line),
        robots=8,
        engine=PlanarSettings(1),
        worlds=2,
        n_starts=3,
    )
    gap_row = env.observations[-1]
    assert (gap_row.name, gap_row.unit) == ("gap", "mm")

    state = env.reset(jax.random.split(jax.random.key(0), 2))
    for step in range(3):
        x = np.asarray(env.poses(state))[..., 0]
        gap = env.named(np.asarray(state.obs))["gap"][..., 0]
        np.testing.assert_allclose(gap, line - x, atol=1e-4)
        np.testing.assert_allclose(state.metrics["share"], (x > line).mean(axis=1))
        np.testing.assert_array_equal(state.metrics["steps"], step + 1)

        action = np.random.default_rng(step).uniform(-1, 1, (2, 8, 2))
        state = env.step(state, action)
        x = np.asarray(env.poses(state))[..., 0]
        np.testing.assert_array_equal(state.reward, x > line)
