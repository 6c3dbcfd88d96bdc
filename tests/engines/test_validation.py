"""Mistakes in an engine of a user: each is a UserError that names the method."""

import re
from pathlib import Path

import jax
import numpy as np
import pytest

from iswarm_mj import make_env
from iswarm_mj.engines.registry import find_engine
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.scenario import Scenario
from iswarm_mj.utils.errors import UserError

N, STEPS = 5, 2
DATA = Path(__file__).parents[1] / "data"
SIX = DATA.parents[1] / "models" / "robot6.xml"
HOST, COMPILED = "teleport.py:TeleportSettings", "glide.py:GlideSettings"
SIGHT = "LightReading(Links(whole, flags, whole, number, number), flags)"
SETTINGS = [
    ("        return 24", "        return None", "bytes_per_robot must be a whole number above 0"),
    ("    far: ", "    threads: int = -1\n    far: ", "threads must be a whole number, at least 0"),
    ("    far: ", "    chunk: int = 0\n    far: ", "chunk must be a whole number above 0"),
    ("    far: ", "    on_host = np.zeros(2)\n    far: ", "on_host must be true or false"),
    ("    far: ", "    identity = 7\n    far: ", "identity must be a dictionary"),
    (
        "lambda n_worlds, n_threads: Teleport(model, self.far)",
        "None",
        "host_engine raised TypeError",
    ),
    ("Teleport(model, self.far)", "None", "host_engine must return an engine"),
]
METHODS = [
    ("def move(", "def other(", "abstract class Teleport .*abstract method '?move"),
    ("def sense(self", "def sense(self, more", "sense raised TypeError"),
    (
        "self.robot, self._far = read_robots(model.robot_file), far",
        "self._far = far",
        "robot raised AttributeError",
    ),
    (
        "self.robot, self._far = read_robots(model.robot_file), far",
        "self.robot = np.zeros(3)",
        "robot must be the",
    ),
    (
        "read_robots(model.robot_file), far",
        f"read_robots({str(SIX)!r}), far",
        r"robot must be .*got others",
    ),
    (
        "Places(np.array(poses, float))",
        "Places(poses[0])",
        r"place must return arrays .* as \.poses .*shape \(5, 3\)",
    ),
    (
        "return bodies.poses",
        "return bodies.poses.tolist()",
        r"poses must return an array as its result \(got list",
    ),
    (SIGHT, "None", r"sense must return LightReading of 6 arrays .*got NoneType"),
    (
        SIGHT,
        SIGHT.replace("whole,", "number,"),
        r"sense must return int32\[1, 5, 4\] as \.links\.sender .*float32",
    ),
    (
        SIGHT,
        SIGHT.replace("whole, flags", "whole + 9, ~flags"),
        r"sense must return a sender from 0 to 4 .*got 9",
    ),
    (
        SIGHT,
        SIGHT.replace("whole, flags", "whole - 1, ~flags"),
        r"sense must return a sender from 0 to 4 .*got -1",
    ),
    (
        SIGHT,
        SIGHT.replace("flags, whole,", "~flags, whole + 4,"),
        r"sense must return a led from 0 to 3 .*got 4",
    ),
    (
        SIGHT,
        SIGHT.replace("flags, whole, number, number", "~flags, whole, number, number * np.nan"),
        "true_distance",
    ),
    ("        return Motion(", "        return (", "move must return a Motion"),
    (
        "            Places(poses),\n",
        "            None,\n",
        "move must return Places of 1 array as its bodies as it was given",
    ),
    ("        poses = bodies.poses\n", "        raise SystemExit(0)\n", "move raised SystemExit"),
]
IN_PROGRAMS = [
    ("def mapping", "def other", "abstract class Glide .*abstract method '?mapping"),
    (
        'return "batch"',
        'return "each"',
        r"Glide.mapping must return one of 'batch', .*\(got 'each'\)",
    ),
    ("model.config.drive.timestep", "'x'", "engine Glide holds a str where JAX expects an array"),
    (
        "Places(poses)\n\n    def poses",
        "Places(poses.astype(int))\n\n    def poses",
        r"poses must return float32\[1, 5, 3\]",
    ),
    (
        "return bodies.poses",
        "return bodies.poses if bodies.poses.sum() else 1",
        "TracerBoolConversionError explains",
    ),
    (
        SIGHT,
        SIGHT.replace("whole, flags", "whole + 9, ~flags"),
        r"Glide.sense must return a sender from 0 to 4 .*got 9",
    ),
    (
        "Places(poses), touching",
        "Places(poses.astype(jnp.float16)), touching",
        "poses of its bodies as it was given",
    ),
]


@pytest.fixture
def engine(tmp_path):
    """Settings of an engine in a file of which a part is replaced."""

    def make(name, old="", new=""):
        file, _, cls = name.partition(":")
        text = (DATA / file).read_text()
        assert old in text
        (tmp_path / file).write_text(text.replace(old, new))
        return find_engine(f"{tmp_path / file}:{cls}").usual()

    return make


def run(config, engine):
    started = Run(Scenario(config, robots=N, engine=engine, steps=STEPS))
    while not started.is_over:
        started.advance()
    return started


@pytest.mark.parametrize("name", [HOST, COMPILED])
@pytest.mark.slow
def test_right_ones_run(small, engine, name):
    assert not run(small, engine(name)).faults


@pytest.mark.parametrize(("old", "new", "message"), [*SETTINGS, *METHODS])
def test_on_the_host(small, engine, old, new, message):
    with pytest.raises(UserError, match=message) as refused:
        run(small, engine(HOST, old, new))
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(("old", "new", "message"), IN_PROGRAMS)
def test_in_programs(small, engine, old, new, message):
    with pytest.raises(UserError, match=message) as refused:
        run(small, engine(COMPILED, old, new))
    assert "\n" not in str(refused.value)


class TestMistakesInLaterSteps:
    """The check before a run does not find them."""

    SENSES = "        shape = (*bodies.poses.shape[:2], "
    COUNTS = "        self.n = getattr(self, 'n', 0) + 1\n"

    def test_exceptions_name_the_line(self, small, engine):
        fails = "        if self.n > 1: raise ValueError('tired')\n"
        late = engine(HOST, self.SENSES, self.COUNTS + fails + self.SENSES)
        sentence = (
            r"^Teleport raised ValueError: tired \(.*teleport\.py, line \d+: `if self\.n > 1: .*`\); "
            "correct it there$"
        )
        with pytest.raises(UserError, match=sentence):
            run(small, late)

    def test_exceptions_in_environments_do_so_too(self, small, engine):
        fails = "        if self.n > 1: raise ValueError('tired')\n"
        late = engine(HOST, self.SENSES, self.COUNTS + fails + self.SENSES)
        env = make_env(config=small, robots=N, engine=late, n_starts=2)
        state = env.reset(jax.random.split(jax.random.key(0), 1))
        with pytest.raises(UserError, match=r"^Teleport raised ValueError: tired \(.*line \d+"):
            env.step(state, np.zeros((1, N, 2), np.float32))

    def test_other_shapes_are_refused(self, small, engine):
        forgets = "        bodies = Places(bodies.poses[:, : 5 - (self.n > 1)])\n"
        late = engine(HOST, self.SENSES, self.COUNTS + forgets + self.SENSES)
        with pytest.raises(UserError, match=r"^Teleport raised \w+: .* \(.*\); correct it there"):
            run(small, late)

    def test_robots_that_get_lost_are_faults(self, small, engine):
        moves = "        poses = bodies.poses\n"
        loses = "        poses = bodies.poses + (np.nan if self.n > 1 else 0.0)\n"
        (fault,) = run(small, engine(HOST, moves, self.COUNTS + loses)).faults
        assert fault.step == 2 and "the pose of robot 0 is not finite" in str(fault)


def test_engines_that_move_robots_by_themselves_do_not_run(small, engine):
    drifts = engine(HOST, "poses = bodies.poses\n", "poses = bodies.poses + 0.2\n")
    with pytest.raises(UserError, match=r"Teleport\.move must leave robots that have no command"):
        run(small, drifts)


@pytest.mark.parametrize(
    ("name", "old", "new", "message"),
    [
        (HOST, SIGHT, "None", "Teleport.sense must return LightReading"),
        (COMPILED, "zero, zero)", "zero * 1.0, zero)", "Glide.move must return int32"),
    ],
)
def test_environments_check_too(small, engine, name, old, new, message):
    with pytest.raises(UserError, match=re.escape(message)):
        env = make_env(config=small, robots=N, engine=engine(name, old, new), n_starts=2)
        env.step(env.reset(jax.random.split(jax.random.key(0), 1)), np.zeros((1, N, 2), np.float32))
