"""Robots from a file do what the paper's do: they clean, are recorded, and messages tell which of six LEDs sent."""

import json

import jax.numpy as jnp
import numpy as np
import pytest
from support.robots import around, robot_xml
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
ARENA = ArenaConfig(size=10, dump_size=3, dust_area_size=2, dust_area_offset=3.5, n_dust=8)
FLAGS = "--arena.size=10 --arena.dump-size=3 --arena.dust-area-size=2 --arena.dust-area-offset=3.5 --arena.n-dust=8"
FLAGS = [*FLAGS.split(), "--robots=16", "--engine=planar", "--impl=numba", f"--robot={SIX}"]


def test_six_sided_robots_clean_and_their_files_name_them(tmp_path):
    main(["clean", *FLAGS, "--steps=300", "--out", str(tmp_path)])
    result = json.loads((tmp_path / "result.json").read_text())
    assert result["delivered"] == 8
    robot = read_robot(SIX)
    assert result["robot"]["file"] == str(SIX)
    assert result["robot"]["half_edges"] == [1.2, 0.8, 0.5]
    assert result["robot"]["sides"]["leds"] == [list(axis) for axis in robot.sides.leds]
    with np.load(tmp_path / "trajectory.npz") as file:
        np.testing.assert_allclose(file["scene_robot_size"], [[2.4e-3, 1.6e-3, 1e-3]] * 16)
        assert file["link_valid"].shape[2] == 6 and file["link_valid"].any(axis=(0, 1)).all()


def test_windows_have_a_slot_for_each_led():
    config = SwarmConfig(arena=ARENA, optics=OpticsConfig(baud_rate=2000, slots=5))
    with pytest.raises(ConfigError, match="at least 6, one for each LED"):
        Run(Scenario(config, strategy=PRESETS["type1"], robots=2, robot_file=SIX, engine=PlanarSettings(1), steps=1))


@pytest.mark.parametrize("n_leds", [2, 4, 5, 8])
def test_messages_carry_the_number_of_each_led(n_leds):
    """Five and more need three bits, which halves the resolution of the range to the dump."""
    led = jnp.arange(n_leds, dtype=jnp.int32)
    dust, dump = (remember(jnp.tile(jnp.array(v), (n_leds, 1)), 3) for v in ([60.0, 25.0], [-40.0, 70.0]))
    sent = {"priority": led % 2 == 0, "dust": dust, "dump": dump}
    payload = payload_for(140.0, n_leds)
    got, parity_holds = payload.unpack(payload.pack(Message(led, sent), n_leds), n_leds)
    assert parity_holds.all()
    np.testing.assert_array_equal(got.led, led)
    np.testing.assert_array_equal(got.payload["priority"], sent["priority"])
    for name, ranges in (("dust", 31), ("dump", 31 if n_leds <= 4 else 15)):
        here, there = got.payload[name], sent[name]
        np.testing.assert_array_equal(here.hop, there.hop)
        lengths = [np.linalg.norm(np.asarray(memory.vector), axis=-1) for memory in (here, there)]
        assert np.abs(lengths[0] - lengths[1]).max() <= 140 / ranges / 2 + 1e-3
        quantum = 140 / ranges
        np.testing.assert_allclose(lengths[0] / quantum, np.round(lengths[0] / quantum), atol=1e-4)
        turned = np.angle((np.asarray(here.vector) @ [1, 1j]) / (np.asarray(there.vector) @ [1, 1j]))
        assert np.abs(turned).max() <= np.pi / 32 + 1e-6


def test_vectors_turn_by_the_direction_of_the_led():
    """The sender at bearing 60 deg shows LED 2, at 120 deg: it looks along 60 + 180 - 120 deg here."""
    sides = read_robot(SIX).sides
    bearing, led = jnp.array([jnp.pi / 3]), jnp.array([2])
    got = to_receiver_frame(remember(jnp.array([[10.0, 0.0]])), bearing, jnp.array([5.0]), led, sides)
    expected = 5 * np.exp(1j * np.pi / 3) + 10 * np.exp(1j * np.radians(120))
    np.testing.assert_allclose(np.asarray(got.vector) @ [1, 1j], [expected], atol=1e-4)


def test_avoidance_follows_the_directions_of_the_sides():
    sides = read_robot(SIX).sides
    rules = rules_of(PRESETS["type1"], StrategyConfig(avoidance_course="crossing", avoidance_sides="all"))
    avoided = is_avoided(rules, jnp.broadcast_to(jnp.arange(6), (1, 6)), sides)[0]
    assert avoided.tolist() == [True, True, True, False, True, True]
    front = rules_of(PRESETS["type1"], StrategyConfig())
    assert listening_sides(front, sides).tolist() == [True] + [False] * 5
    askew = Sides(SIDES[1:] + SIDES[:1], SIDES)  # LEDs to the left of their sides
    assert listening_sides(front, askew).tolist() == [True, False, False, False]
    assert is_avoided(rules, jnp.arange(4)[None], askew).tolist() == [[True, False, True, True]]
    walls = senses_nothing(1, sides=6)._replace(sees_wall=jnp.array([[False, True, False, False, False, False]]))
    push = np.asarray(avoidance_push(SwarmConfig().static, rules, walls, jnp.array([False]), sides))[0]
    np.testing.assert_allclose(push / np.linalg.norm(push), [-0.5, -np.sqrt(0.75)], atol=1e-5)


def test_probes_anywhere_get_over_the_ball():
    """Turned and moved as commanded, again and again, tips of several kinds end on it, from all around."""
    tips = np.repeat([(0.9, 0.0), (0.8, 0.5), (1.1, 0.1), (-0.7, -0.3), (-0.9, 0.0)], 16, axis=0)
    config, angles, n = SwarmConfig().static, np.tile(np.linspace(-3.1, 3.1, 16), 5), len(tips)
    ball, at, heading = 1.5 * np.exp(1j * angles), np.zeros(n, complex), np.ones(n, complex)
    for _ in range(6):
        seen = (ball - at) / heading
        vector = jnp.asarray(np.stack([seen.real, seen.imag], axis=-1), jnp.float32)
        command = approach_ball(config, tips, jnp.ones(n, bool), vector, Command(jnp.zeros(n), jnp.zeros(n)))
        heading = heading * np.exp(1j * np.asarray(command.turn, float))
        at = at + heading * np.asarray(command.forward, float)
    np.testing.assert_allclose(at + heading * (tips @ [1, 1j]), ball, atol=1e-4)


def test_robots_too_large_for_the_arena_are_refused(tmp_path, capsys):
    path = tmp_path / "large.xml"
    path.write_text(robot_xml((6, 6), around((6, 6), (0, 90, 180, 270))))
    with pytest.raises(SystemExit):
        main(["clean", *FLAGS[:-1], f"--robot={path}", "--out", str(tmp_path / "out")])
    assert "--robots must be between 1 and" in capsys.readouterr().err
