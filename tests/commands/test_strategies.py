"""A strategy in a file outside the package: every engine runs, carries and records it; it shares a
swarm with others, and packages offer it by name.

What is refused in such files stands in refusals.txt.
"""

import json
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
from iswarm_mj.strategy.library import STRATEGIES, find, offered
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.units import ROBOT_DIAMETER

ROOT = Path(__file__).parents[2]
WALK = (ROOT / "tests/data/walk.py").read_text()
N_ROBOTS = 12
N_STEPS = 6
ARENA = (
    "--arena.size=10",
    "--arena.dump-size=3",
    "--arena.dust-area-size=2",
    "--arena.dust-area-offset=3.5",
    "--arena.n-dust=5",
)
FEW = (*ARENA, f"--robots={N_ROBOTS}")
QUIET = ("--optics.error-in-communication=0", "--optics.p-communication-break=0")
"""Flags with which every message that is in sight arrives as it was sent."""


@pytest.fixture(autouse=True)
def walk_py(here):
    (here / "walk.py").write_text(WALK)


def trajectory(*flags, strategies=("walk.py:Walk",), n_robots=N_ROBOTS):
    """Return the recorded arrays of a short run of `iswarm clean` with strategies."""
    steps = f"--steps={N_STEPS}"
    swarm = (*ARENA, f"--robots={n_robots}")
    assert code_of("clean", "--strategy", *strategies, *swarm, steps, *flags) == 0
    with np.load("runs/clean/trajectory.npz") as file:
        return dict(file)


def table_of_robots(run):
    """Return the columns of a run's robots by their names, as arrays of steps x robots."""
    return {
        name: run.robots[name].to_numpy(zero_copy_only=False).reshape(N_STEPS + 1, N_ROBOTS)
        for name in run.robots.column_names
    }


def check_turns(frames):
    """Check that robots turn as they remember, by at most the 40 degrees of the flag."""
    turned = frames["turned"]
    assert turned.shape == (N_STEPS + 1, N_ROBOTS)
    assert (turned[0] == 0).all()
    turns = np.diff(turned, axis=0)
    assert np.deg2rad(20) < np.abs(turns).max() <= np.deg2rad(40.001)

    # Contacts, which begin before robots touch, turn robots, too.
    rotations = np.diff(frames["pose"][..., 2], axis=0)
    is_free = np.abs(rotations - turns) < 1e-3
    assert is_free.mean() > 0.3


def check_messages(table, links):
    """Check that robots say what they remembered, rounded, and heed what they hear."""
    for name, level, highest in (("count", 1, 15), ("heat", 1 / 255, 1), ("aim", 2 * np.pi / 8, 4)):
        sent = table[f"said_{name}"].astype(float)
        assert np.isnan(sent[0]).all()
        assert np.abs(sent[1:]).max() <= highest
        np.testing.assert_allclose(sent[1:] / level, np.round(sent[1:] / level), atol=1e-3)
        if name != "aim":  # an angle, which wraps
            remembered = np.clip(table[name][:-1], 0, highest)
            np.testing.assert_allclose(sent[1:], remembered, atol=level / 2 + 1e-6)

    assert all(links["is_heard"])
    assert len(links["step"]) > 20
    for step, receiver, sender in zip(
        links["step"], links["receiver"], links["sender"], strict=True
    ):
        assert table["count"][step, receiver] >= table["said_count"][step, sender]
    assert (table["count"][-1] > np.arange(N_ROBOTS)).any()


@pytest.mark.parametrize(
    "engine",
    [
        "mujoco",
        "planar",
        pytest.param("planar --impl=warp", marks=pytest.mark.slow),
        pytest.param("mjx", marks=pytest.mark.slow),
    ],
)
def test_every_engine_runs_carries_and_records_it(engine):
    frames = trajectory("--turn=40", *QUIET, "--engine", *engine.split())
    check_turns(frames)
    assert frames["scene_memory_names"].tolist() == ["count", "heat", "turned"]
    assert frames["scene_memory_units"].tolist() == ["", "", "rad"]
    assert "dust_vector" not in frames

    # The tables have columns of what it remembers and says, with units.
    with warnings.catch_warnings(action="error"):
        run = iswarm_mj.load("runs/clean")
    table = table_of_robots(run)
    np.testing.assert_array_equal(table["turned"], frames["turned"])
    units = {
        name: run.robots.schema.field(name).metadata[b"unit"]
        for name in ("turned", "said_aim", "said_heat")
    }
    assert units == {"turned": b"rad", "said_aim": b"rad", "said_heat": b""}
    assert not {"said_dust_x", "said_priority"} & set(table)
    check_messages(table, run.links.to_pydict())

    # The result names the class and its settings.
    result = json.loads(Path("runs/clean/result.json").read_text())
    assert result["strategy"] == {"class": "Walk", "turn": 40.0}
    assert run.result == result
    assert run.genome is None
    assert "genome" not in result

    # So does the recording for Rerun.
    entities = read("runs/clean/clean.rrd")
    turned = np.array(entities["/memory/turned"]["Scalars:scalars"])
    np.testing.assert_allclose(turned, frames["turned"], rtol=1e-6)
    said_count = np.array(entities["/world/robots/body"]["said_count"])
    np.testing.assert_array_equal(said_count[1:], table["said_count"][1:])


@pytest.mark.slow
def test_in_turn_news_goes_further_within_a_step():
    """It has a method `listen`, which sequential updates need."""
    listen = """
    def listen(self, memory, seen, key):
        return self.act(memory, seen, key)[0]
"""
    Path("walk.py").write_text(WALK + listen)
    flags = ["--engine=planar", "--robots=25", "--seed=1", "--steps=6"]

    def sum_of_counts(order):
        """Return the sum of the numbers that robots know of after two steps."""
        update_order = f"--strategy.update-order={order}"
        code = code_of("clean", "--strategy", "walk.py:Walk", *ARENA, *flags, update_order)
        assert code == 0
        counts = iswarm_mj.load("runs/clean").robots["count"].to_numpy().reshape(7, 25)
        return counts[2].sum()

    assert sum_of_counts("sequential") > sum_of_counts("synchronous")


class TestInstalled:
    @pytest.fixture(autouse=True)
    def package(self, here, monkeypatch):
        """Write what an installer writes about this package, and about one that offers Walk."""
        project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
        points = project["entry-points"]["iswarm_mj.strategies"] | {"theirs": "walk:Walk"}
        lines = [f"{name} = {value}" for name, value in points.items()]

        info = here / "own-1.0.dist-info"
        info.mkdir()
        (info / "METADATA").write_text("Metadata-Version: 2.1\nName: own\nVersion: 1.0\n")
        (info / "entry_points.txt").write_text("\n".join(["[iswarm_mj.strategies]", *lines]))
        monkeypatch.syspath_prepend(here)

    def test_presets_and_strategies_of_other_packages_have_names(self):
        for name, genome in PRESETS.items():
            assert parse(["clean", "--strategy", name]).rules == genome
        genome = parse(["clean", "--strategy", "type2", "--p-vector-forget", "0.5"]).rules
        assert (genome.p_vector_forget, genome.weight_find_dump) == (0.5, 1.0)
        assert parse(["clean", "--strategy", "theirs", "--turn=7"]).strategy_plugin.turn == 7

    def test_a_class_is_found_by_its_fields_if_it_is_the_only_one(self, here):
        assert offered(STRATEGIES, "Walk", {"turn"}) == "theirs"
        assert offered(STRATEGIES, "Walk", {"turn", "pace"}) is None

        points = here / "own-1.0.dist-info" / "entry_points.txt"
        points.write_text(points.read_text() + "\ntwin = walk:Walk")
        assert offered(STRATEGIES, "Walk", {"turn"}) is None

    def test_the_names_are_listed_where_one_is_unknown(self, capfd):
        assert code_of("clean", "--strategy", "their") == 2
        error = capfd.readouterr().err
        assert "installed (beeclust, evolved, forager, neural, theirs, type1, type2)" in error
        assert error.endswith("; perhaps you meant theirs\n")


POLICY = """
import jax.numpy as jnp

from iswarm_mj.envs import PolicyStrategy

def apply(step, obs):
    return jnp.zeros((len(obs), 2)).at[:, 1].set(step)

policy = PolicyStrategy(apply, jnp.float32(0.8))
"""
"""A policy without parameters of its own: walk 0.8 of the longest step straight ahead."""


@pytest.mark.parametrize("name", [r"C:\code\walk.py", r"C:\code\walk.py:Walk"])
def test_the_colon_of_a_drive_begins_no_class(name):
    with pytest.raises(UserError, match=r"strategy file C:\\code\\walk\.py does not exist"):
        find(STRATEGIES, name)


def test_a_learned_policy_is_a_whole_strategy(here):
    (here / "learned.py").write_text(POLICY)
    """Of so few robots contacts brake hardly any."""
    strategies = ("learned.py:policy",)
    poses = trajectory("--drive.error-step=0", strategies=strategies, n_robots=5)["pose"]
    distances = np.linalg.norm(poses[1, :, :2] - poses[0, :, :2], axis=-1)
    assert np.median(distances) == pytest.approx(0.8 * 0.5 * ROBOT_DIAMETER, rel=1e-3)


SILENT = """

class Quiet(Walk):
    payload = {}
    recorded = {"turned": "rad"}

    def act(self, memory, seen, key):
        turn = jnp.deg2rad(self.turn) * jax.random.uniform(key, seen.at_dust.shape, minval=-1)
        return memory | {"turned": memory["turned"] + turn}, Command(turn, jnp.full_like(turn, 1.0))
"""


class TestTeams:
    NAMES = ("walk.py:Quiet=0.5", "walk.py:Quiet=0.25", "type2=0.25")

    @pytest.fixture(autouse=True)
    def quiet_walk(self, walk_py):
        Path("walk.py").write_text(WALK + SILENT)

    @pytest.mark.slow
    def test_each_has_a_share_flags_and_recordings(self):
        """Files repeat the run."""
        flags = ("--Quiet.turn=20", "--Quiet2.turn=40", "--type2.p-vector-forget=0.5")
        first = trajectory(*flags, "--engine=planar", strategies=self.NAMES)
        assert first["scene_team_names"].tolist() == ["Quiet", "Quiet2", "type2"]
        assert first["scene_team_sizes"].tolist() == [6, 3, 3]

        strategy = json.loads(Path("runs/clean/result.json").read_text())["strategy"]
        assert strategy["Quiet"]["turn"] == 20.0
        assert strategy["Quiet2"]["turn"] == 40.0
        assert strategy["type2"]["p_vector_forget"] == 0.5

        has_turned = first["Quiet_turned"][-1] != 0
        assert has_turned.tolist() == [True] * 6 + [False] * 6
        has_turned = first["Quiet2_turned"][-1] != 0
        assert has_turned.tolist() == [False] * 6 + [True] * 3 + [False] * 3

        Path("runs/clean/result.json").rename("again.json")
        second = trajectory("--config=again.json", "--engine=planar", strategies=self.NAMES)
        np.testing.assert_array_equal(second["pose"], first["pose"])

    def test_the_page_states_their_command(self):
        names = ("walk.py:Quiet=9", "type1=3")
        session = parse(["play", "--strategy", *names, *FEW, "--engine=planar"]).session()
        values = session.wanted.values()
        assert values["strategy"] == names
        assert "--strategy walk.py:Quiet=9 type1=3" in command_line("run", values)

        again = session.wanted.set("strategy", session.wanted.get("strategy"))
        assert again.strategy.sizes(N_ROBOTS) == (9, 3)


FACTORIES = """
from iswarm_mj.strategy.base import StrategyFactory
from iswarm_mj.strategy.genome import TYPE1, TYPE2


class Maker(StrategyFactory):
    def __init__(self, genome=TYPE1):
        self.genome = genome

    def for_world(self, config, robot, n_robots):
        return self.genome.for_world(config, robot, n_robots)


OF_TYPE2 = Maker(TYPE2)
"""


def test_a_team_keeps_its_object_where_another_one_has_its_class(here):
    (here / "makers.py").write_text(FACTORIES)
    command = parse(["run", "--strategy", "makers.py:Maker=0.5", "makers.py:OF_TYPE2=0.5"])
    genomes = [team.strategy.genome for team in command.strategy_plugin.teams]
    assert genomes == [PRESETS["type1"], PRESETS["type2"]]
