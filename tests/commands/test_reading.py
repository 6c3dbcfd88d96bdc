"""The flag `--reading`: defaults of the other flags."""

from dataclasses import asdict

import pytest

from iswarm_mj.commands.main import main, parse
from iswarm_mj.config import READINGS


@pytest.mark.parametrize("command", ["clean", "bench", "evolve", "experiment"])
@pytest.mark.parametrize("reading", READINGS)
def test_a_reading_is_the_default_of_the_flags(command, reading):
    extra = ["hop-count"] if command == "experiment" else []
    assert parse([command, *extra, "--reading", reading]).config == READINGS[reading]


def test_without_the_flag_it_is_the_papers():
    assert parse(["clean"]).config == READINGS["paper"]


@pytest.mark.parametrize("order", [["--reading", "initial"], ["--reading=initial"]])
def test_flags_go_before_the_reading(order):
    """Also those that give a value that is the default of the other reading."""
    flags = ["--strategy.avoidance-sides", "front", "--strategy.random-turn", "90"]
    for arguments in (order + flags, flags + order):
        strategy = asdict(parse(["clean", *arguments]).config.strategy)
        initial = asdict(READINGS["initial"].strategy)
        assert strategy == initial | {"avoidance_sides": "front", "random_turn": 90.0}


@pytest.mark.parametrize("command", ["clean", "evolve", "infer", "experiment density", "bench"])
@pytest.mark.parametrize("flag", ["--reading mine", "--reading=mine"])
def test_an_unknown_reading_is_refused_by_a_sentence(command, flag, capfd):
    with pytest.raises(SystemExit) as end:
        main([*command.split(), *flag.split()])
    out, error = capfd.readouterr()
    assert end.value.code == 2 and out == ""
    assert error == "iswarm: --reading must be paper or initial (got 'mine')\n"
