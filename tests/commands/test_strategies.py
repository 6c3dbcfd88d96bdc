"""A strategy in a file outside the package: every engine runs, carries and records it; its errors
are explained."""

import json
import re
import tomllib
import warnings
from pathlib import Path

import numpy as np
import pytest
from support.cli import code_of
from support.rrd import read

import iswarm_mj
from iswarm_mj.commands.main import parse
from iswarm_mj.simulation.scenario_flags import command_line
from iswarm_mj.strategy.genome import PRESETS
from iswarm_mj.strategy.library import STRATEGIES, offered
from iswarm_mj.utils.units import ROBOT_DIAMETER

WALK = '''
from dataclasses import dataclass
from typing import Annotated

import jax
import jax.numpy as jnp

from iswarm_mj.sensors.fields import Bearing, Integer, Real
from iswarm_mj.strategy.base import Strategy
from iswarm_mj.strategy.interface import Command
from iswarm_mj.utils.constraints import Within

@dataclass
class Walk(Strategy):
    turn: Annotated[float, Within(0, 180, "deg")] = 30.0
    """Largest turn of a step [deg]."""
    payload = {"count": Integer(bits=4), "heat": Real(0, 1, bits=8), "aim": Bearing(bits=3)}
    recorded = {"count": "", "heat": "", "turned": "rad"}

    def init(self, n_robots, key):
        count, zero = jnp.arange(n_robots), jnp.zeros(n_robots)
        return {"count": count, "heat": count / n_robots, "aim": zero, "turned": zero}
    def say(self, memory, is_loaded):
        return {name: memory[name] for name in self.payload}
    def picks(self, memory):
        return memory["turned"] < jnp.inf
    def act(self, memory, seen, key):
        def largest(name):
            return jnp.where(seen.is_heard, seen.payload[name], memory[name][:, None]).max(axis=1)
        turn = jnp.deg2rad(self.turn) * jax.random.uniform(key, seen.at_dust.shape, minval=-1)
        heard = {"count": jnp.maximum(memory["count"], largest("count")), "heat": largest("heat"), "aim": turn}
        return {**heard, "turned": memory["turned"] + turn}, Command(turn, jnp.full_like(turn, 1.0))
'''
"""With a flag and messages of its own."""
N, STEPS = 12, 6
FEW = (
    "--arena.size=10",
    "--arena.dump-size=3",
    "--arena.dust-area-size=2",
    "--arena.dust-area-offset=3.5",
)
FEW += ("--arena.n-dust=5", f"--robots={N}", f"--steps={STEPS}")
QUIET = ("--optics.error-in-communication=0", "--optics.p-communication-break=0")


@pytest.fixture(autouse=True)
def walk(here):
    """The file, in the working directory."""
    (here / "walk.py").write_text(WALK)


def changed(old, new):
    """Write the file with a part replaced; its lines count from 1."""
    assert old in WALK
    Path("walk.py").write_text(WALK.replace(old, new))
    return 1 + WALK[: WALK.index(old)].count("\n")


def walked(*flags, names=("walk.py:Walk",)):
    assert code_of("clean", "--strategy", *names, *FEW, *flags) == 0
    with np.load("runs/clean/trajectory.npz") as file:
        return dict(file)


def wrong(capfd, *names, command="clean", flags=()):
    """The one sentence with which `iswarm` refuses a strategy."""
    assert code_of(command, "--strategy", *names, *FEW, *flags) == 2
    out, error = capfd.readouterr()
    said = re.sub(r"iswarm: (placing|preparing) [^\n]*\n", "", error)
    assert out == "" and re.fullmatch(r"iswarm: [^\n]*\n", said), error
    return said


@pytest.mark.parametrize(
    "engine",
    [
        pytest.param(engine, id=" ".join(engine), marks=[pytest.mark.slow] * is_slow)
        for engine, is_slow in [
            (["mujoco"], 0),
            (["planar"], 0),
            (["planar", "--impl=warp"], 1),
            (["mjx"], 1),
        ]
    ],
)
def test_every_engine_runs_carries_and_records_it(engine):
    frames = walked("--turn=40", *QUIET, "--engine", *engine)
    turned = frames["turned"]
    assert turned.shape == (STEPS + 1, N) and (turned[0] == 0).all()
    steps = np.diff(turned, axis=0)
    assert np.abs(steps).max() <= np.deg2rad(40.001) and np.abs(steps).max() > np.deg2rad(20)
    free = (
        np.abs(np.diff(frames["pose"][..., 2], axis=0) - steps) < 1e-3
    )  # a contact turns robots, too
    assert free.mean() > 0.5
    assert frames["scene_memory_names"].tolist() == ["count", "heat", "turned"]
    assert frames["scene_memory_units"].tolist() == ["", "", "rad"] and "dust_vector" not in frames
    with warnings.catch_warnings(action="error"):
        run = iswarm_mj.load("runs/clean")
    names = run.robots.column_names
    table = {
        name: run.robots[name].to_numpy(zero_copy_only=False).reshape(STEPS + 1, N)
        for name in names
    }
    np.testing.assert_array_equal(table["turned"], turned)
    units = [
        run.robots.schema.field(name).metadata[b"unit"]
        for name in ("turned", "said_aim", "said_heat")
    ]
    assert units == [b"rad", b"rad", b""]
    content = json.loads(Path("runs/clean/result.json").read_text())
    assert content["strategy"] == {"class": "Walk", "turn": 40.0}
    assert run.result == content and run.genome is None and "genome" not in content
    assert "said_dust_x" not in table and "said_priority" not in table
    for name, step, most in (("count", 1, 15), ("heat", 1 / 255, 1), ("aim", 2 * np.pi / 8, 4)):
        said = table[f"said_{name}"]
        assert np.isnan(said[0].astype(float)).all() and np.abs(said[1:]).max() <= most
        if name != "aim":  # a robot says what it remembered
            np.testing.assert_allclose(
                said[1:], np.clip(table[name][:-1], 0, most), atol=step / 2 + 1e-6
            )
        np.testing.assert_allclose(
            said[1:] / step, np.round(said[1:].astype(float) / step), atol=1e-3
        )
    links = run.links.to_pydict()
    assert all(links["is_heard"]) and len(links["step"]) > 20
    for step, receiver, sender in zip(
        links["step"], links["receiver"], links["sender"], strict=True
    ):
        assert table["count"][step, receiver] >= table["said_count"][step, sender]
    assert (table["count"][-1] > np.arange(N)).any()
    entities = read("runs/clean/clean.rrd")
    entity = entities["/memory/turned"]
    np.testing.assert_allclose(
        np.array([row for row in entity["Scalars:scalars"]]), turned, rtol=1e-6
    )
    body = entities["/world/robots/body"]
    np.testing.assert_array_equal(np.array(body["said_count"])[1:], table["said_count"][1:])


def test_in_turn_news_goes_further_within_a_step():
    """With a method `listen`, which sequential updates need."""
    listen = (
        "    def listen(self, memory, seen, key):\n        return self.act(memory, seen, key)[0]\n"
    )
    Path("walk.py").write_text(WALK + listen)
    flags = ("--engine=planar", "--robots=25", "--seed=1")
    orders = [
        (*flags, f"--strategy.update-order={order}") for order in ("synchronous", "sequential")
    ]
    known = []
    for own in orders:
        assert code_of("clean", "--strategy", "walk.py:Walk", *FEW[:-2], "--steps=6", *own) == 0
        known.append(
            iswarm_mj.load("runs/clean").robots["count"].to_numpy().reshape(7, 25)[2].sum()
        )
    assert known[1] > known[0]


class TestInstalled:
    @pytest.fixture(autouse=True)
    def package(self, here, monkeypatch):
        """What an installer writes about this package, from its own declaration, and about
        another."""
        groups = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text())[
            "project"
        ]["entry-points"]
        points = groups["iswarm_mj.strategies"] | {"theirs": "walk:Walk"}
        info = here / "own-1.0.dist-info"
        info.mkdir()
        (info / "METADATA").write_text("Metadata-Version: 2.1\nName: own\nVersion: 1.0\n")
        lines = ["[iswarm_mj.strategies]", *(f"{name} = {value}" for name, value in points.items())]
        (info / "entry_points.txt").write_text("\n".join(lines))
        monkeypatch.syspath_prepend(here)

    def test_presets_and_strategies_of_other_packages_have_names(self):
        for name, genome in PRESETS.items():
            assert parse(["clean", "--strategy", name]).rules == genome
        command = parse(["clean", "--strategy", "type2", "--p-vector-forget", "0.5"])
        assert command.rules.p_vector_forget == 0.5 and command.rules.weight_find_dump == 1.0
        assert parse(["clean", "--strategy", "theirs", "--turn=7"]).own.turn == 7

    def test_names_of_classes_are_found_if_there_is_one(self, here):
        assert offered(STRATEGIES, "Walk", {"turn"}) == "theirs"
        assert offered(STRATEGIES, "Walk", {"turn", "pace"}) is None
        points = here / "own-1.0.dist-info" / "entry_points.txt"
        points.write_text(points.read_text() + "\ntwin = walk:Walk")
        assert offered(STRATEGIES, "Walk", {"turn"}) is None

    def test_unknown_names(self, capfd):
        error = wrong(capfd, "typ2")
        assert "installed (beeclust, evolved, forager, neural, theirs, type1, type2)" in error
        assert "perhaps you meant type2" in error


LAST = "heard = {"
MISTAKES = [
    (("wlk.py:Walk",), "", "", "strategy file wlk.py does not exist"),
    (("walk.py:Wlk",), "", "", "walk.py has no Wlk; its strategies are Walk"),
    (
        ("walk.py",),
        "@dataclass\n",
        "class Base:\n    pass\n\n@dataclass\n",
        "names no class; its strategies are Walk;",
    ),
    (
        (),
        "def picks(self, memory):",
        "def picks(self, memory)",
        r"SyntaxError: .*, line LINE: `def picks\(self, memory\)`",
    ),
    (
        (),
        "@dataclass\nclass Walk(Strategy):",
        "class Walk(Strategy):\n    def __init__(self):\n        self.a = 1 / 0\n",
        r"raised ZeroDivisionError: .*walk\.py, line \d+: `self.a = 1 / 0`",
    ),
    (
        (),
        "turn: ",
        "steps: int = 3\n    turn: ",
        "has a field steps, but --steps is already a flag of iswarm clean",
    ),
    (
        (),
        LAST,
        f"if seen.at_dust.any(): turn = 0\n        {LAST}",
        r"Walk\.act .*, line LINE: `if seen.*TracerBool",
    ),
    (
        (),
        LAST,
        f"import numpy; turn = numpy.sin(turn)\n        {LAST}",
        r"Walk\.act .*, line LINE: .*TracerArray",
    ),
    ((), "Command(turn, ", "Command(turn[:2], ", r"turn of its command \(got float32\[2\]\)"),
    (
        (),
        '"turned": memory["turned"] + turn}',
        '"turned": memory["count"]}',
        r"its memory .*got int32\[12",
    ),
    (
        (),
        'memory["turned"] < jnp.inf',
        'memory["count"]',
        r"picks must return bool\[12\] as its result \(got int32",
    ),
    ((), '"turned": "rad"', '"turn": "rad"', "recorded names 'turn', which its memory lacks"),
    (
        (),
        "zero = jnp.arange(n_robots), jnp.zeros(n_robots)",
        "zero = jnp.arange(n_robots), jnp.zeros(3)",
        "of the 12 robots",
    ),
    ((), '"turned"', '"pose"', "cannot be called pose"),
    ((), '"turned"', '"file"', "cannot be called file"),
    (
        (),
        "Integer(bits=4)",
        "Integer(bits=21)",
        "payload of 32 bits .* leave out or shorten fields by 3 bits",
    ),
    ((), '"count": Integer', '"led": Integer', "cannot be called 'led'"),
    (
        (),
        "for name in self.payload}",
        "for name in ('heat', 'aim')}",
        "by name what payload declares, count, heat, aim .got ",
    ),
    ((), "{name: memory[name] ", "{name: memory['count'] ", "float32.12. as its field heat"),
    (
        (),
        "payload = ",
        "payloads = ",
        "Walk.payloads is never used: Strategy has payload, but no payloads",
    ),
    (("walk.py:Walk", "type1"), "", "", "NAME=SHARE"),
    (("walk.py:Walk=0.5", "type1=x"), "", "", "NAME=SHARE"),
    (("walk.py:Walk=0.5", "type1=0.6"), "", "", "add up to 1"),
    (("walk.py:Walk=0.5", "type1=2"), "", "", "one kind"),
    (("walk.py:Walk=3", "type1=2"), "", "", "--robots to 5"),
    (("walk.py:Walk=0.5", "--strategy", "type1=0.5"), "", "", "--strategy is given twice"),
]


@pytest.mark.parametrize(("names", "old", "new", "words"), MISTAKES)
def test_mistakes(capfd, names, old, new, words):
    line = changed(old, new)
    error = wrong(capfd, *(names or ["walk.py:Walk"]), flags=["--engine=planar"])
    assert re.search(words.replace("LINE", str(line)), error), error


def test_what_a_task_finds_wrong_with_its_flags(capfd):
    task = Path(iswarm_mj.__file__).parent / "tasks" / "foraging.py"
    error = wrong(
        capfd, "walk.py:Walk", command="run", flags=[f"--task={task}:Foraging", "--sources=6"]
    )
    assert re.search(
        r"^iswarm: --sources must be at most 5, the items .* \(--arena.n-dust\) \(got 6\)", error
    )


POLICY = """
import jax.numpy as jnp

from iswarm_mj.envs import PolicyStrategy

def apply(step, obs):
    return jnp.zeros((len(obs), 2)).at[:, 1].set(step)

policy = PolicyStrategy(apply, jnp.float32(0.8))
"""


def test_a_learned_policy_is_a_whole_strategy(here):
    (here / "learned.py").write_text(POLICY)
    start, end = walked("--drive.error-step=0", names=("learned.py:policy",))["pose"][:2]
    moved = np.hypot(*(end - start)[:, :2].T)
    assert np.median(moved) == pytest.approx(0.8 * 0.5 * ROBOT_DIAMETER, rel=1e-3)


SILENT = """
class Quiet(Walk):
    payload, recorded = {}, {"turned": "rad"}

    def act(self, memory, seen, key):
        turn = jnp.deg2rad(self.turn) * jax.random.uniform(key, seen.at_dust.shape, minval=-1)
        return memory | {"turned": memory["turned"] + turn}, Command(turn, jnp.full_like(turn, 1.0))
"""


def test_teams():
    """Shares, flags with the teams' names, files that repeat the run, and commands that the page
    states."""
    Path("walk.py").write_text(WALK + SILENT)
    names = ("walk.py:Quiet=0.5", "walk.py:Quiet=0.25", "type2=0.25")
    flags = (
        "--Quiet.turn=20",
        "--Quiet2.turn=40",
        "--type2.p-vector-forget=0.5",
        "--engine=planar",
    )
    first = walked(*flags, names=names)
    assert first["scene_team_names"].tolist() == ["Quiet", "Quiet2", "type2"]
    assert first["scene_team_sizes"].tolist() == [6, 3, 3]
    result = json.loads(Path("runs/clean/result.json").read_text())
    assert [result["strategy"][name].get("turn") for name in ("Quiet", "Quiet2")] == [20.0, 40.0]
    assert result["strategy"]["type2"]["p_vector_forget"] == 0.5
    turned = [first[f"{name}_turned"][-1] != 0 for name in ("Quiet", "Quiet2")]
    assert np.array_equal(
        turned, [[True] * 6 + [False] * 6, [False] * 6 + [True] * 3 + [False] * 3]
    )
    Path("runs/clean/result.json").rename("again.json")
    second = walked("--config=again.json", "--engine=planar", names=names)
    np.testing.assert_array_equal(second["pose"], first["pose"])
    session = parse(
        ["play", "--strategy", "walk.py:Quiet=9", "type1=3", *FEW[:-1], "--engine=planar"]
    ).session()
    values = session.wanted.values()
    assert values["strategy"] == ("walk.py:Quiet=9", "type1=3")
    assert "--strategy walk.py:Quiet=9 type1=3" in command_line("run", values)
    assert session.wanted.set("strategy", session.wanted.get("strategy")).strategy.sizes(N) == (
        9,
        3,
    )
