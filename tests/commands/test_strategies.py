"""A strategy in a file outside the package: it runs on every engine and is recorded; its errors are explained."""

import json
import re
import textwrap
import tomllib
import warnings
from pathlib import Path

import numpy as np
import pytest
from helpers_cli import code_of
from helpers_rrd import read

import iswarm_mj
from iswarm_mj.commands import main as cli
from iswarm_mj.commands.main import parse
from iswarm_mj.player.scenario import command_line
from iswarm_mj.strategy.genome import PRESETS
from iswarm_mj.utils.units import ROBOT_DIAMETER

WALK = '''
from dataclasses import dataclass
from typing import Annotated

import jax
import jax.numpy as jnp

from iswarm_mj.strategy.interface import Command
from iswarm_mj.utils.constraints import Within

@dataclass
class Walk:
    turn: Annotated[float, Within(0, 180, "deg")] = 30.0
    """Largest turn of a step [deg]."""
    recorded = {"turned": "rad"}

    def init(self, n_robots, key):
        return {"turned": jnp.zeros(n_robots)}
    def picks(self, memory):
        return memory["turned"] < jnp.inf
    def act(self, memory, seen, key):
        turn = jnp.deg2rad(self.turn) * jax.random.uniform(key, seen.at_dust.shape, minval=-1)
        return {"turned": memory["turned"] + turn}, Command(turn, jnp.full_like(turn, 1.0))
'''
"""At most 25 lines of code."""
SMALL = ("--arena.size=15", "--arena.dump-size=3", "--arena.dust-area-size=3", "--arena.dust-area-offset=5")
FEW = (*SMALL, "--arena.n-dust=5", "--robots=4", "--steps=6")


@pytest.fixture(autouse=True)
def walk(here):
    """The file, in the working directory."""
    (here / "walk.py").write_text(WALK)


def refused(capfd, *arguments):
    """The one sentence with which `iswarm` refuses."""
    assert code_of(*arguments) == 2
    out, error = capfd.readouterr()
    assert out == "" and re.fullmatch(r"iswarm: [^\n]*\n", error), error
    return error


def changed(old, new):
    """Write the file with a part replaced; its lines count from 1."""
    assert old in WALK
    Path("walk.py").write_text(WALK.replace(old, new))
    return 1 + WALK[: WALK.index(old)].count("\n")


def walked(*flags, names=("walk.py:Walk",)):
    assert code_of("clean", "--strategy", *names, *FEW, *flags) == 0
    with np.load("runs/clean/trajectory.npz") as file:
        return dict(file)


@pytest.mark.parametrize(
    "engine",
    [
        pytest.param(engine, id=" ".join(engine), marks=[pytest.mark.slow] * is_slow)
        for engine, is_slow in [(["mujoco"], 0), (["planar"], 0), (["planar", "--impl=warp"], 1), (["mjx"], 1)]
    ],
)
def test_every_engine_runs_and_records_it(engine):
    frames = walked("--turn=40", "--engine", *engine)
    turned = frames["turned"]
    assert turned.shape == (7, 4) and (turned[0] == 0).all()
    steps = np.diff(turned, axis=0)
    assert np.abs(steps).max() <= np.deg2rad(40.001) and np.abs(steps).max() > np.deg2rad(20)
    free = np.abs(np.diff(frames["pose"][..., 2], axis=0) - steps) < 1e-3  # a contact turns robots, too
    assert free.mean() > 0.5
    assert frames["scene_memory_names"].tolist() == ["turned"] and frames["scene_memory_units"].tolist() == ["rad"]
    assert "dust_vector" not in frames
    with warnings.catch_warnings(action="error"):
        run = iswarm_mj.load("runs/clean")
    np.testing.assert_array_equal(run.robots["turned"].to_numpy().reshape(7, 4), turned)
    assert run.units["robots"]["turned"] == "rad" and run.genome is None and run.strategy["class"] == "Walk"
    content = json.loads(Path("runs/clean/result.json").read_text())
    assert content["strategy"] == {"class": "Walk", "turn": 40.0} and "genome" not in content
    entity = read("runs/clean/clean.rrd")["/memory/turned"]
    np.testing.assert_allclose(np.array([row for row in entity["Scalars:scalars"]]), turned, rtol=1e-6)


class TestInstalled:
    @pytest.fixture(autouse=True)
    def package(self, here, monkeypatch):
        """What an installer writes about this package, from its own declaration, and about another."""
        groups = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text())["project"]["entry-points"]
        points = groups["iswarm_mj.strategies"] | {"theirs": "walk:Walk"}
        info = here / "own-1.0.dist-info"
        info.mkdir()
        (info / "METADATA").write_text("Metadata-Version: 2.1\nName: own\nVersion: 1.0\n")
        lines = ["[iswarm_mj.strategies]", *(f"{name} = {value}" for name, value in points.items())]
        (info / "entry_points.txt").write_text("\n".join(lines))
        monkeypatch.syspath_prepend(here)

    def test_presets_are_strategies(self):
        for name, genome in PRESETS.items():
            assert cli.parse(["clean", "--strategy", name]).checked()[1] == genome
        command = cli.parse(["clean", "--strategy", "type2", "--p-vector-forget", "0.5"])
        assert command.checked()[1].p_vector_forget == 0.5 and command.checked()[1].weight_find_dump == 1.0

    def test_other_packages_offer_theirs(self):
        assert walked(names=("theirs",))["turned"].any()

    def test_unknown_names(self, capfd):
        error = refused(capfd, "clean", "--strategy", "typ2")
        assert (
            "installed (beeclust, evolved, forager, neural, theirs, type1, type2)" in error
            and "perhaps you meant type2" in error
        )


class TestMistakes:
    def wrong(self, capfd, name="walk.py:Walk", *flags):
        return refused(capfd, "clean", "--strategy", name, *FEW, *flags)

    def test_files_and_classes(self, capfd):
        assert "strategy file wlk.py does not exist" in self.wrong(capfd, "wlk.py:Walk")
        assert "walk.py has no Wlk; its strategies are Walk" in self.wrong(capfd, "walk.py:Wlk")
        assert "names no class; its strategies are Walk" in self.wrong(capfd, "walk.py")

    def test_syntax(self, capfd):
        line = changed("    def picks(self, memory):", "    def picks(self, memory)")
        assert re.search(rf"SyntaxError: .*walk\.py, line {line}: `def picks\(self, memory\)`", self.wrong(capfd))

    def test_an_object_that_cannot_be_made(self, capfd):
        changed("@dataclass\nclass Walk:", "class Walk:\n    def __init__(self):\n        self.a = 1 / 0\n")
        assert re.search(r"raised ZeroDivisionError: .*walk\.py, line \d+: `self.a = 1 / 0`", self.wrong(capfd))

    def test_what_a_task_finds_wrong_with_its_flags(self, capfd):
        task = Path(iswarm_mj.__file__).parent / "tasks" / "foraging.py"
        error = refused(capfd, "run", f"--task={task}:Foraging", *FEW, "--sources=6")
        assert re.search(r"^iswarm: --sources must be at most 5, the items .* \(--arena.n-dust\) \(got 6\)", error)

    def test_flags_that_the_command_has(self, capfd):
        changed("    turn: ", "    steps: int = 3\n    turn: ")
        assert "Walk has a field steps, but --steps is already a flag of iswarm clean" in self.wrong(capfd)

    @pytest.mark.parametrize(
        "statement, words",
        [
            ("if seen.at_dust.any(): turn = turn * 0", "jnp.where"),
            ("import numpy; turn = numpy.sin(turn)", "jax.numpy"),
        ],
    )
    def test_python_on_traced_values(self, capfd, statement, words):
        last = 'return {"turned": memory["turned"] + turn}'
        line = changed(last, f"{statement}\n        {last}")
        error = self.wrong(capfd)
        assert re.search(rf"Walk\.act .*walk\.py, line {line}: `{re.escape(statement)}`\).*{re.escape(words)}", error)

    @pytest.mark.parametrize(
        "old, new, words",
        [
            ("Command(turn, ", "Command(turn[:2], ", r"turn of its command \(got float32\[2\]\)"),
            ('{"turned": "rad"}', '{"turn": "rad"}', "recorded names 'turn', which its memory lacks"),
            ('{"turned": jnp.zeros(n_robots)}', '{"turned": jnp.zeros(3)}', "axis must be that of the 4 robots"),
        ],
    )
    def test_shapes_and_types(self, capfd, old, new, words):
        changed(old, new)
        assert re.search(words, self.wrong(capfd))

    @pytest.mark.parametrize("name", ["pose", "file"])
    def test_names_that_trajectories_or_their_writer_have(self, capfd, name):
        Path("walk.py").write_text(textwrap.dedent(WALK).replace('"turned"', f'"{name}"'))
        assert f"cannot be called {name}" in self.wrong(capfd)


POLICY = """
import jax.numpy as jnp

from iswarm_mj.envs import PolicyStrategy

def apply(step, obs):
    return jnp.zeros((len(obs), 2)).at[:, 1].set(step)

policy = PolicyStrategy(apply, jnp.float32(0.8))
"""


def test_a_learned_policy_is_a_whole_strategy(here):
    (here / "learned.py").write_text(POLICY)
    assert code_of("clean", "--strategy=learned.py:policy", *FEW, "--drive.error-step=0") == 0
    start, end = np.load(here / "runs/clean/trajectory.npz")["pose"][:2]
    moved = np.hypot(*(end - start)[:, :2].T)
    assert np.median(moved) == pytest.approx(0.8 * 0.5 * ROBOT_DIAMETER, rel=1e-3)


def test_teams(here):
    """Shares, flags with the teams' names, and files that repeat the run."""
    names = ("walk.py:Walk=0.5", "walk.py:Walk=0.25", "type2=0.25")
    flags = ("--Walk.turn=20", "--Walk2.turn=40", "--type2.p-vector-forget=0.5", "--engine=planar")
    first = walked(*flags, names=names)
    assert first["scene_team_names"].tolist() == ["Walk", "Walk2", "type2"]
    assert first["scene_team_sizes"].tolist() == [2, 1, 1]
    result = json.loads(Path("runs/clean/result.json").read_text())
    assert [result["strategy"][name].get("turn") for name in ("Walk", "Walk2")] == [20.0, 40.0]
    assert result["strategy"]["type2"]["p_vector_forget"] == 0.5
    turns = np.abs(first["Walk_turned"][-1]), np.abs(first["Walk2_turned"][-1])
    assert turns[0][:2].all() and turns[1][2] and not turns[0][2:].any() and not turns[1][[0, 1, 3]].any()
    Path("runs/clean/result.json").rename("again.json")
    assert code_of("clean", "--config=again.json", "--strategy", *names, "--engine=planar") == 0
    with np.load("runs/clean/trajectory.npz") as second:
        np.testing.assert_array_equal(second["pose"], first["pose"])


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("walk.py:Walk", "type1"), "NAME=SHARE"),
        (("walk.py:Walk=0.5", "type1"), "NAME=SHARE"),
        (("walk.py:Walk=0.5", "type1=x"), "NAME=SHARE"),
        (("walk.py:Walk=0.5", "type1=0.6"), "add up to 1"),
        (("walk.py:Walk=0.5", "type1=2"), "one kind"),
        (("walk.py:Walk=3", "type1=2"), "--robots to 5"),
        (("walk.py:Walk=0.5", "walk.py:Run=0.5"), "walk.py:Walk"),
        (("walk.py:Walk=0.5", "--strategy", "type1=0.5"), "--strategy is given twice"),
    ],
)
def test_teams_that_are_none_are_refused(words, says, capfd):
    assert says in refused(capfd, "clean", "--strategy", *words, *FEW, "--engine=planar")


def test_play_states_teams():
    command = parse(["play", "--strategy", "walk.py:Walk=3", "type1=1", *FEW[:-1], "--engine=planar"])
    session = command.session()
    values = session.wanted.values()
    assert values["strategy"] == ("walk.py:Walk=3", "type1=1")
    assert "--strategy walk.py:Walk=3 type1=1" in command_line("run", values)
    assert session.wanted.set("strategy", session.wanted.get("strategy")).strategy.sizes(4) == (3, 1)
