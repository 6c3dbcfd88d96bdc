"""What the parser refuses, and how: exit code 2, what was meant, nothing written; settings in messages become flags."""

import re

import pytest
from helpers_cli import code_of

from iswarm_mj.commands.flags import in_flags
from iswarm_mj.commands.main import parse
from iswarm_mj.config import READINGS
from iswarm_mj.utils.errors import ConfigError, FaultKind, SimulationFault

OWN = "run --strategy beeclust --task aggregation"


@pytest.mark.parametrize(
    ("line", "facts"),
    [
        ("clean --stepz 10", ["--stepz", "--steps"]),
        ("clean --no-recrod", ["--no-recrod", "--record"]),
        ("clean --robotz 5", ["perhaps you meant --robots"]),
        ("clean extra", ["extra"]),
        (f"{OWN} --robotss 3", ["--robotss", "--robots"]),
        ("clean --seed -1", ["--seed", "(got -1)"]),
        ("clean --arena.size 12 8", ["8"]),
        ("experiment hopcount", ["perhaps you meant hop-count"]),
        ("report --strategy neural --task x", ["--strategy"]),
        ("clean --steps abc", ["--steps", "abc"]),
        ("clean --arena.obstacles 1 2 3 --seed 2", ["--arena.obstacles"]),
        ("clean --gripper.resolution lunch", ["--gripper.resolution", "lunch", "quasi-static", "dynamic"]),
        ("clean --out=", ["--out", "name of a file"]),
        ("clean --robots 5 --robots 7", ["--robots is given twice"]),
        ("clean --record --no-record", ["--record is given twice"]),
        ("clean --arena.n_dust 5 --arena.n-dust 7", ["is given twice"]),
        ("claen", ["perhaps you meant clean", "Commands: clean, run, "]),
        ("", ["no command was given. Commands: clean, "]),
    ],
)
def test_is_refused(line, facts, capfd, here):
    assert code_of(*line.split()) == 2
    out, error = capfd.readouterr()
    assert (
        out == ""
        and "Traceback" not in error
        and re.fullmatch(r"iswarm: [^\n]*\n", error)
        and list(here.iterdir()) == []
    )
    assert [fact for fact in facts if fact not in error] == []


@pytest.mark.parametrize("line", [["clean", "--\x1b[31mred"], ["clean", "--steps", "\x1b[31m"], ["\x1b[31m"]])
@pytest.mark.parametrize("times", [1, 2000])
def test_what_is_echoed_is_short_and_controls_no_terminal(line, times, capfd):
    assert code_of(*line[:-1], line[-1] * times) == 2
    error = capfd.readouterr().err
    assert "\x1b" not in error and len(error) < 3000


@pytest.mark.parametrize("command", ["clean", "experiment"])
@pytest.mark.parametrize("reading", READINGS)
def test_a_reading_is_the_default_of_the_flags(command, reading):
    extra = ["hop-count"] if command == "experiment" else []
    assert parse([command, *extra, "--reading", reading]).config == READINGS[reading]


@pytest.mark.parametrize("order", [slice(None), slice(None, None, -1)])
def test_flags_go_before_the_reading(order):
    """Also those that give a value that is the default of the other reading."""
    parts = [["--reading", "initial"], ["--strategy.avoidance-sides", "front", "--strategy.random-turn=90"]]
    strategy = parse(["clean", *(word for part in parts[order] for word in part)]).config.strategy
    initial = vars(READINGS["initial"].strategy)
    assert vars(strategy) == initial | {"avoidance_sides": "front", "random_turn": 90.0}


@pytest.mark.parametrize(
    "error, text",
    [
        (ConfigError("arena.dump_size", 7, "small"), "--arena.dump-size must be small (got 7)"),
        (ConfigError("n_robots", 0, "at least `n_worlds`"), "--robots must be at least --worlds (got 0)"),
        (ConfigError("worlds", 2, "1", "use `jax.pmap`"), "--worlds must be 1 (got 2); use `jax.pmap`"),
        (ConfigError("strategy", "x", "known"), "--strategy must be known (got 'x')"),
        (
            SimulationFault(kind=FaultKind.TOO_MANY_CONTACTS),
            "contact buffer full; use fewer robots, or with mjx increase --contact-capacity",
        ),
    ],
)
def test_settings_in_messages_are_flags(error, text):
    from iswarm_mj.commands.flags import settings

    assert in_flags(error, [name for name, *_ in settings(parse(["clean", "--engine", "mjx"]))]) == text
