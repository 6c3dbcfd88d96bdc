"""What flags default to: `--config`, a TOML file of flags or the result.json of an earlier run, and
`--reading`."""

import json
from importlib.metadata import EntryPoint

import pytest

from iswarm_mj.commands.main import main, parse
from iswarm_mj.config.swarm import INTERPRETATIONS
from iswarm_mj.strategy import library
from iswarm_mj.utils.errors import UserError

RUN = """
steps = 8
robots = 12
record = false
use-hop-count = false
record_worlds = [0, 1]
worlds = 2
reading = "initial"

[arena]
size = 15
dump-size = 3
dust-area-size = 3
dust-area-offset = 5
n_dust = 24

[optics]
line-of-sight = false
"""


@pytest.fixture(autouse=True)
def run_toml(here):
    (here / "run.toml").write_text(RUN)


def test_keys_are_flags():
    command = parse(["clean", "--config", "run.toml"])
    assert (command.steps, command.robots, command.record, command.record_worlds) == (
        8,
        12,
        False,
        (0, 1),
    )
    assert command.own.use_hop_count is False
    assert (command.arena.size, command.arena.dump_size, command.arena.n_dust) == (15.0, 3.0, 24)
    assert (
        command.optics.line_of_sight is False
        and command.strategy == INTERPRETATIONS["initial"].strategy
    )


@pytest.mark.parametrize("order", [0, 1])
def test_flags_override_the_file(order):
    flags, file = (
        ["--steps", "9", "--record", "--arena.size=20", "--record-worlds", "1"],
        ["--config=run.toml"],
    )
    command = parse(["clean", *(file + flags if order else flags + file)])
    assert (command.steps, command.record, command.arena.size, command.arena.n_dust) == (
        9,
        True,
        20.0,
        24,
    )
    assert command.record_worlds == (1,)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (
            "wings = 2",
            "x.toml names wings, which iswarm clean does not know; `iswarm clean --help-all` lists",
        ),
        (
            "[arena]\nsise = 3\nwings = 1",
            "names arena.sise, arena.wings, which .*; perhaps you meant arena.size; ",
        ),
        ("steps = ", "x.toml is no TOML"),
        (f"steps = 0x{'f' * 4000}", "steps must be .*too many digits"),
        (f"{'.'.join('a' * 2000)} = 1", "x.toml is no TOML"),
        ("[arena]\nn-dust = 5\nn_dust = 7", r"arena\.n_dust occurs twice"),
        ('record_worlds = ["--seed=3"]', "record_worlds must be .* no flag, .*got --seed=3"),
        ("optics.baud-rate = []", "Missing value for argument '--optics.baud-rate'"),
        (
            "\n".join(f"key{n} = 1" for n in range(20_000)),
            r"names key0, key1, .{1,100}\.\.\., which",
        ),
    ],
)
def test_what_a_file_must_not_have(here, text, says):
    (here / "x.toml").write_text(text)
    with pytest.raises(UserError, match=says):
        parse(["clean", "--config", "x.toml"])


def test_lists_are_whole_values(here):
    """Also empty ones; and words after them are not theirs."""
    (here / "x.toml").write_text("no_contact_gap = []")
    assert parse(["grasp", "--config", "x.toml"]).no_contact_gap == ()
    (here / "y.toml").write_text('draw = ["trails"]')
    command = parse(["replay", "--config", "y.toml", "runs/other"])
    assert (command.draw, str(command.directory)) == (("trails",), "runs/other")


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (None, "x.json cannot be read"),
        ("{}", "x.json is not the result.json of a run"),
        ({"config": 5}, "x.json is not the result.json of a run"),
        ({"strategy": None}, "x.json is not the result.json of a run"),
        (
            {"strategy": {"class": "Walk", "turn": 40.0}},
            "is of the strategy Walk; name it by --strategy",
        ),
    ],
)
def test_files_that_are_no_result(here, content, says):
    if content is not None:
        result = {"settings": {}, "config": {}} | content if isinstance(content, dict) else {}
        (here / "x.json").write_text(json.dumps(result))
    with pytest.raises(UserError, match=says):
        parse(["clean", "--config", "x.json"])


def test_a_result_repeats_its_run(here):
    """Every measure is the same, and so are all settings."""
    flags = "--record --out a --engine planar --impl numba"
    main(["clean", "--config", "run.toml", "--seed", "7", *flags.split(" ")])
    main(["clean", "--config", "a/result.json", "--out", "b", "--no-record"])
    first, second = (json.loads((here / name / "result.json").read_text()) for name in "ab")
    assert first["picked"] and first["genome"]["use_hop_count"] is False and first["seed"] == 7
    assert [key for key in first if first[key] != second[key]] in (
        ["wall_s", "seconds"],
        ["seconds"],
        [],
    )


TASK = {
    "class": "Aggregation",
    "spot_radius": 8.0,
    "spot_offset": 14.0,
    "dim": 0.25,
    "error_light": 0.05,
}
WALK = {
    "class": "Beeclust",
    "longest_wait": 200.0,
    "half_light": 0.5,
    "meeting": 1.4,
    "leaving": 4.0,
}


@pytest.fixture
def offered(monkeypatch):
    """The package's own tasks and strategies, as if it were installed."""
    points = [
        EntryPoint("aggregation", "iswarm_mj.tasks.aggregation:Aggregation", "iswarm_mj.tasks"),
        EntryPoint("beeclust", "iswarm_mj.tasks.aggregation:Beeclust", "iswarm_mj.strategies"),
    ]
    monkeypatch.setattr(
        library, "entry_points", lambda group: [p for p in points if p.group == group]
    )


def test_a_result_of_another_task_repeats_it(here, offered):
    (here / "x.json").write_text(
        json.dumps({"settings": {"seed": 3}, "config": {}, "strategy": WALK, "task": TASK})
    )
    command = parse(["run", "--config", "x.json", "--dim", "0.3"])
    assert (command.task.spot_radius, command.task.dim, command.own.longest_wait) == (
        8.0,
        0.3,
        200.0,
    )
    assert (command.task_name, command.controller, command.seed) == (
        "aggregation",
        ("beeclust",),
        3,
    )
    with pytest.raises(
        UserError,
        match="names the task aggregation, but iswarm clean has none; `iswarm run --config x",
    ):
        parse(["clean", "--config", "x.json"])


def test_a_strategy_in_a_file(here):
    (here / "own.py").write_text("from iswarm_mj.strategy.genome import TYPE2")
    (here / "x.toml").write_text(
        'strategy = "own.py:TYPE2"\nfraction-scouts = 0.5\n"strategy.random-turn" = 10'
    )
    command = parse(["clean", "--config", "x.toml"])
    assert command.own.fraction_scouts == 0.5 and command.own.density_of_robots == 0.132
    assert command.strategy.random_turn == 10.0


def test_a_flag_replaces_what_does_not_go_with_it(here):
    """The settings of a file's engine, and its density of robots."""
    (here / "x.json").write_text(
        json.dumps({"settings": {}, "config": {}, "engine": "mjx", "impl": "jax"})
    )
    assert parse(["clean", "--config", "x.json", "--engine", "mujoco"]).engine == "mujoco"
    (here / "x.toml").write_text("density = 0.1\n")
    command = parse(["clean", "--config", "x.toml", "--robots", "5"])
    assert (command.robots, command.density) == (5, None)
    (here / "x.toml").write_text("robots = 9\n")
    command = parse(["clean", "--config", "x.toml", "--density", "0.2"])
    assert (command.robots, command.density) == (None, 0.2)


@pytest.mark.parametrize("command", ["clean", "experiment"])
@pytest.mark.parametrize("reading", INTERPRETATIONS)
def test_a_reading_is_the_default_of_the_flags(command, reading):
    extra = ["hop-count"] if command == "experiment" else []
    assert parse([command, *extra, "--reading", reading]).config == INTERPRETATIONS[reading]


@pytest.mark.parametrize("order", [slice(None), slice(None, None, -1)])
def test_flags_go_before_the_reading(order):
    """Also those that give a value that is the default of the other reading."""
    parts = [
        ["--reading", "initial"],
        ["--strategy.avoidance-sides", "front", "--strategy.random-turn=90"],
    ]
    strategy = parse(["clean", *(word for part in parts[order] for word in part)]).config.strategy
    initial = vars(INTERPRETATIONS["initial"].strategy)
    assert vars(strategy) == initial | {"avoidance_sides": "front", "random_turn": 90.0}


def test_rows_of_a_file_are_numbers_of_a_flag(here):
    (here / "boxes.toml").write_text("[arena]\nobstacles = [[8, 8, 2, 0.5, 30], [0, 9, 1, 1, 0]]")
    by_file = parse(["clean", "--config", "boxes.toml"]).config
    assert by_file.arena.obstacles == ((8.0, 8.0, 2.0, 0.5, 30.0), (0.0, 9.0, 1.0, 1.0, 0.0))
