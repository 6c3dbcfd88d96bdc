"""The command and the file that the page offers repeat a run, bit by bit."""

import shlex
import tomllib
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from support.sessions import PAGE_SCENARIO, assert_copies_repeat, begun, names_of, steps

from iswarm_mj.commands.main import parse
from iswarm_mj.config.swarm import ArenaConfig, SwarmConfig
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.player.scenario import PageScenario
from iswarm_mj.player.session import Session
from iswarm_mj.simulation.scenario_flags import toml
from iswarm_mj.strategy.genome import PRESETS, TYPE1
from iswarm_mj.strategy.teams import Teams
from iswarm_mj.tasks.aggregation import Aggregation, Beeclust
from iswarm_mj.utils.errors import UserError


@pytest.fixture
def assert_repeats(tmp_path):
    """A function that asserts that the command and the file of a session give its state."""
    return partial(assert_copies_repeat, folder=tmp_path)


# Settings and changes.


def test_a_run_with_changes(assert_repeats):
    session = begun(n=2)
    session.set("p_vector_forget", 0.75)
    session.set("optics.error_in_communication", 0.5)
    session.set("use_hop_count", False)
    params, _ = session.run.arrays()
    np.testing.assert_array_equal(params.strategy.rules.p_vector_forget, np.float32([0.75]))
    np.testing.assert_array_equal(params.conditions.error_in_communication, np.float32([0.5]))

    steps(session, 3)
    session.change("kill", "4")
    session.change("ball", "2.5,-1.5")
    steps(session, 3)
    assert names_of(session.changes) == [
        "2:p_vector_forget=0.75",
        "2:optics.error_in_communication=0.5",
        "2:use_hop_count=false",
        "5:kill=4",
        "5:ball=2.5,-1.5",
    ]
    assert_repeats(session)
    unchanged = begun(n=8)
    poses = session.snapshots[-1].frames.pose
    assert not np.array_equal(unchanged.snapshots[-1].frames.pose, poses)


def test_another_task_and_strategy_whose_settings_change(assert_repeats):
    obstacle = (5.0, 5.0, 1.0, 2.0, 30.0)
    arena = ArenaConfig(size=24.0, dust_area_offset=7.0, obstacles=(obstacle,))
    scenario = PageScenario(
        SwarmConfig(arena),
        strategy=Beeclust(longest_wait=20.0),
        task=Aggregation(spot_radius=4.0, spot_offset=7.0),
        robots=12,
        engine=PlanarSettings(),
    )
    session = begun(scenario, n=4)
    assert session.command().startswith("iswarm run ")
    assert_repeats(session)

    spots = session.snapshots[-1].frames.task["area_bright"]
    session.set("spot_radius", 3.0)  # of the task, while it runs
    steps(session, 3)
    smaller = session.snapshots[-1].frames.task["area_bright"]
    np.testing.assert_allclose(smaller[..., 2], 0.75 * spots[..., 2])
    assert names_of(session.changes) == ["4:spot_radius=3.0"]
    assert_repeats(session)


def test_switches_of_a_genome():
    """The density is not copied, as the number of robots is given."""
    switched = replace(TYPE1, use_hop_count=not TYPE1.use_hop_count)
    scenario = replace(PAGE_SCENARIO, strategy=replace(switched, density_of_robots=0.2))
    arguments = shlex.split(Session(scenario).command())[2:-2]
    copy = parse(["play", *arguments]).session()
    assert copy.start.genome == switched


@pytest.mark.slow
def test_robots_that_are_moved_and_fail(assert_repeats):
    scenario = replace(PAGE_SCENARIO, failing="0.2:2")
    session = begun(scenario, n=2)
    session.change("move", "3,9.0,-9.0")
    steps(session, 2)
    session.change("fail", "0.25")
    session.change("move", "4,-9.0,9.0")
    steps(session, 2)
    assert session.is_alive.sum() == 12
    assert "--failing 0.2:2" in session.command()
    assert_repeats(session)


@pytest.mark.slow
def test_rules_of_one_team_that_change(assert_repeats):
    session = begun(of_teams(type1=TYPE1, type2=PRESETS["type2"]), n=2)
    session.set("type2.p_vector_forget", 0.75)
    steps(session, 2)
    assert names_of(session.changes) == ["2:type2.p_vector_forget=0.75"]
    assert_repeats(session)


def test_defaults_of_a_users_class_are_not_listed(tmp_path):
    file = tmp_path / "walk.py"
    file.write_text(
        "from dataclasses import dataclass\n"
        "from iswarm_mj.tasks.aggregation import Beeclust\n\n\n"
        "@dataclass(frozen=True)\nclass Walk(Beeclust):\n    turn: float = 40.0\n"
    )
    flags = ["--task=aggregation", f"--strategy={file}:Walk", "--robots=8", "--engine=planar"]
    scenario = parse(["play", *flags]).session().start
    assert scenario.values().keys() == {"robots", "task", "strategy", "engine"}
    assert scenario.set("turn", 30.0).values()["turn"] == 30.0


# Teams.

TEAMS = (
    "play --strategy type1=0.5 type2=0.5 --robots=10 --engine=planar"
    " --arena.size=24 --arena.n-dust=12 --arena.dust-area-offset=7"
)


@pytest.mark.parametrize(
    "flags",
    [
        "",
        pytest.param("--type1.p-vector-forget=0.9", marks=pytest.mark.slow),
        "--changes 2:kill=3 3:optics.error_in_communication=0.25",
    ],
)
@pytest.mark.slow
def test_teams_of_flags(flags, assert_repeats):
    session = parse(f"{TEAMS} {flags}".split()).session()
    assert_repeats(steps(session, 5))


def of_teams(**teams):
    """Return a scenario of two teams with half of the robots each, by their names."""
    shares = {name: (0.5, genome) for name, genome in teams.items()}
    return replace(PAGE_SCENARIO, strategy=Teams(shares), robots=10)


@pytest.mark.slow
def test_teams_of_python_whose_names_are_presets(assert_repeats):
    changed = replace(PRESETS["type2"], weight_find_dust=0.125)
    session = begun(of_teams(type1=TYPE1, type2=changed), n=2)
    assert "--strategy type1=0.5 type2=0.5" in session.command()
    assert "--type2.weight-find-dust 0.125" in session.command()
    assert_repeats(session)


@pytest.mark.parametrize("names", [("red", "blue"), ("type1", "red")])
def test_teams_of_other_names_cannot_be_copied(names):
    genome = replace(PRESETS["type2"], weight_find_dust=0.125)
    session = Session(of_teams(**dict.fromkeys(names, genome)))
    with pytest.raises(UserError, match="no flag can state the names and shares of the teams"):
        session.command()


# Classes and files.


def test_a_class_of_no_file_cannot_be_copied():
    nameless = type("Own", (Beeclust,), {"__module__": "nowhere"})
    scenario = PageScenario(strategy=nameless(), task=Aggregation())
    with pytest.raises(UserError, match="no command can name Own"):
        scenario.values()


def test_a_strategy_of_a_file_with_an_odd_name(tmp_path, assert_repeats):
    file = tmp_path / "🤖 'a\\b\x7f.py"
    file.write_text(
        "from iswarm_mj.tasks.aggregation import Beeclust\n\n\nclass Walk(Beeclust):\n    pass\n"
    )
    flags = ["--task=aggregation", f"--strategy={file}:Walk", "--robots=8", "--engine=planar"]
    session = parse(["play", *flags]).session()
    assert_repeats(steps(session, 1))


@pytest.mark.parametrize(
    "text",
    [
        "🤖.py:Walk",
        'a"b',
        "a\\b",
        "a\nb\tc\x00\x1f\x7f\x80",
        "ä é ß",
        "'",
        "=",
        "# no comment",
        "\\u0041",
        " ",
    ],
)
def test_files_hold_any_text(text):
    values = {"strategy": text, "optics.größe": (1.5, text), "is": True, "n": 3, "x": 1e-300}
    content = tomllib.loads(toml(values).encode().decode())
    assert content == {
        "strategy": text,
        "optics": {"größe": [1.5, text]},
        "is": True,
        "n": 3,
        "x": 1e-300,
    }


def test_files_hold_no_text_that_is_not_utf_8():
    with pytest.raises(UserError, match="no TOML can hold"):
        toml({"strategy": "\udcff.py:Walk"})
