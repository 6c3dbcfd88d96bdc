"""Robots from a file do what the paper's do: they clean and are recorded.

Their messages carry the number of the LED that sent.
"""

import json

import jax.numpy as jnp
import numpy as np
import pytest
from support.sensing import remember, senses_nothing

from iswarm_mj.commands.main import main
from iswarm_mj.config.swarm import ArenaConfig, OpticsConfig, StrategyConfig, SwarmConfig
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.engines.robot_file import models_directory, read_robot
from iswarm_mj.geometry.robot import SIDES, Sides
from iswarm_mj.sensors.messages import Message
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.scenario import Scenario
from iswarm_mj.strategy.avoidance import is_avoided, listening_sides
from iswarm_mj.strategy.controller import approach_ball, avoidance_push
from iswarm_mj.strategy.genome import PRESETS
from iswarm_mj.strategy.interface import Command
from iswarm_mj.strategy.rules import rules_of
from iswarm_mj.strategy.vector_strategy import payload_for
from iswarm_mj.strategy.vectors import to_receiver_frame
from iswarm_mj.utils.errors import ConfigError

SIX = models_directory() / "robot6.xml"
"""A robot of six sides."""
ARENA = ArenaConfig(size=10, dump_size=3, dust_area_size=2, dust_area_offset=3.5, n_dust=8)
FLAGS = [
    "--arena.size=10",
    "--arena.dump-size=3",
    "--arena.dust-area-size=2",
    "--arena.dust-area-offset=3.5",
    "--arena.n-dust=8",
    "--robots=16",
    "--engine=planar",
    "--impl=numba",
]
RANGE = 140.0
"""Range of vectors in messages [mm]."""


def as_complex(vectors):
    """Vectors (..., 2) as complex numbers."""
    return np.asarray(vectors) @ [1, 1j]


class TestCleaning:
    @pytest.fixture(scope="class")
    @classmethod
    def out(cls, tmp_path_factory):
        """Directory of a run of six-sided robots."""
        out = tmp_path_factory.mktemp("six")
        main(["clean", *FLAGS, f"--robot={SIX}", "--steps=300", "--out", str(out)])
        return out

    def test_results_describe_the_robot(self, out):
        content = json.loads((out / "result.json").read_text())
        assert content["delivered"] == 8
        assert content["robot"]["file"] == str(SIX)
        assert content["robot"]["half_edges"] == [1.2, 0.8, 0.5]
        leds = [list(axis) for axis in read_robot(SIX).sides.leds]
        assert content["robot"]["sides"]["leds"] == leds

    def test_trajectories_have_six_sides(self, out):
        with np.load(out / "trajectory.npz") as file:
            np.testing.assert_allclose(file["scene_robot_size"], [[2.4e-3, 1.6e-3, 1e-3]] * 16)
            is_link = file["link_valid"]
        assert is_link.shape[2] == 6 and is_link.any(axis=(0, 1)).all()


def test_windows_have_a_slot_for_each_led():
    config = SwarmConfig(arena=ARENA, optics=OpticsConfig(baud_rate=2000, slots=5))
    with pytest.raises(ConfigError, match="at least 6, one for each LED"):
        Run(Scenario(config, robots=2, robot_file=SIX, engine=PlanarSettings(1), steps=1))


class TestMessages:
    """Messages of robots with some LEDs, one from each LED."""

    DUST = (60.0, 25.0)
    DUMP = (-40.0, 70.0)

    @pytest.fixture(params=[2, 4, 5, 8])
    def n_leds(self, request):
        return request.param

    @pytest.fixture
    def sent(self, n_leds):
        led = jnp.arange(n_leds, dtype=jnp.int32)
        dust = remember(jnp.tile(jnp.array(self.DUST), (n_leds, 1)), 3)
        dump = remember(jnp.tile(jnp.array(self.DUMP), (n_leds, 1)), 3)
        return Message(led, {"priority": led % 2 == 0, "dust": dust, "dump": dump})

    @pytest.fixture
    def received(self, n_leds, sent):
        payload = payload_for(RANGE, n_leds)
        message, parity_holds = payload.unpack(payload.pack(sent, n_leds), n_leds)
        assert parity_holds.all()
        return message

    def test_they_carry_the_number_of_the_led_and_the_flag(self, sent, received):
        np.testing.assert_array_equal(received.led, sent.led)
        priority = sent.payload["priority"]
        np.testing.assert_array_equal(received.payload["priority"], priority)

    @pytest.mark.parametrize("name", ["dust", "dump"])
    def test_five_leds_and_more_halve_the_resolution_of_the_range_to_the_dump(
        self, n_leds, sent, received, name
    ):
        """Their numbers need three bits."""
        n_ranges = 15 if name == "dump" and n_leds > 4 else 31
        quantum = RANGE / n_ranges
        vector = as_complex(received.payload[name].vector)
        original = as_complex(sent.payload[name].vector)
        np.testing.assert_array_equal(received.payload[name].hop, sent.payload[name].hop)
        error = np.abs(vector) - np.abs(original)
        assert np.abs(error).max() <= quantum / 2 + 1e-3
        n_quanta = np.abs(vector) / quantum
        np.testing.assert_allclose(n_quanta, np.round(n_quanta), atol=1e-4)
        assert np.abs(np.angle(vector / original)).max() <= np.pi / 32 + 1e-6


def test_vectors_turn_by_the_direction_of_the_led():
    """The sender at bearing 60 deg shows LED 2, at 120 deg: it looks along 60 + 180 - 120 deg."""
    sides = read_robot(SIX).sides
    bearing = jnp.array([jnp.pi / 3])
    distance = jnp.array([5.0])
    sent = remember(jnp.array([[10.0, 0.0]]))
    received = to_receiver_frame(sent, bearing, distance, jnp.array([2]), sides)
    expected = 5 * np.exp(1j * np.pi / 3) + 10 * np.exp(1j * np.radians(120))
    np.testing.assert_allclose(as_complex(received.vector), [expected], atol=1e-4)


class TestAvoidance:
    """Robots avoid by the directions of their sides, of six sides or with LEDs beside them."""

    SIX_SIDES = read_robot(SIX).sides
    LEDS_TO_THE_LEFT = Sides(SIDES[1:] + SIDES[:1], SIDES)
    CROSSING = rules_of(
        PRESETS["type1"],
        StrategyConfig(avoidance_course="crossing", avoidance_sides="all"),
    )
    FRONT = rules_of(PRESETS["type1"], StrategyConfig())

    def test_robots_that_show_their_back_are_not_avoided(self):
        leds = jnp.arange(6)[None]
        is_six_avoided = is_avoided(self.CROSSING, leds, self.SIX_SIDES)
        assert is_six_avoided.tolist() == [[True, True, True, False, True, True]]
        leds = jnp.arange(4)[None]
        is_four_avoided = is_avoided(self.CROSSING, leds, self.LEDS_TO_THE_LEFT)
        assert is_four_avoided.tolist() == [[True, False, True, True]]

    def test_the_front_listens(self):
        assert listening_sides(self.FRONT, self.SIX_SIDES).tolist() == [True] + [False] * 5
        listens = listening_sides(self.FRONT, self.LEDS_TO_THE_LEFT)
        assert listens.tolist() == [True, False, False, False]

    def test_a_wall_on_a_side_pushes_away_from_it(self):
        sees_wall = jnp.array([[False, True, False, False, False, False]])
        seen = senses_nothing(1, sides=6)._replace(sees_wall=sees_wall)
        config = SwarmConfig().static
        push = avoidance_push(config, self.CROSSING, seen, jnp.array([False]), self.SIX_SIDES)[0]
        direction = np.asarray(push) / np.linalg.norm(push)
        np.testing.assert_allclose(direction, [-0.5, -np.sqrt(0.75)], atol=1e-5)


def test_probes_anywhere_get_over_the_ball():
    """Tips of several kinds end on the ball, from all around, by repeated turns and walks."""
    tips_of_kinds = [(0.9, 0.0), (0.8, 0.5), (1.1, 0.1), (-0.7, -0.3), (-0.9, 0.0)]
    n_angles = 16
    tips = np.repeat(tips_of_kinds, n_angles, axis=0)
    angles = np.tile(np.linspace(-3.1, 3.1, n_angles), len(tips_of_kinds))
    n_robots = len(tips)
    ball = 1.5 * np.exp(1j * angles)

    config = SwarmConfig().static
    sees_ball = jnp.ones(n_robots, bool)
    stand = Command(jnp.zeros(n_robots), jnp.zeros(n_robots))
    position = np.zeros(n_robots, complex)
    heading = np.ones(n_robots, complex)
    for _ in range(6):
        seen = (ball - position) / heading
        vector = jnp.asarray(np.stack([seen.real, seen.imag], axis=-1), jnp.float32)
        command = approach_ball(config, tips, sees_ball, vector, stand)
        heading = heading * np.exp(1j * np.asarray(command.turn, float))
        position = position + heading * np.asarray(command.forward, float)
    np.testing.assert_allclose(position + heading * as_complex(tips), ball, atol=1e-4)
