"""`iswarm infer` runs what its flags say."""

from pathlib import Path

import pytest

from iswarm_mj.commands.main import main, parse
from iswarm_mj.experiments.runner import experiment
from iswarm_mj.experiments.runner.pool import Execution
from iswarm_mj.experiments.studies.infer import SETTINGS


def test_flags_arrive(monkeypatch):
    asked = []
    monkeypatch.setattr(experiment, "run_experiment", lambda *given: asked.append(given))
    flags = "--combinations 40 --repeats 3 --seed 7 --engine planar --workers 2 --again --out there"
    parse(["infer", *flags.split(), "--strategy.dust-range", "0.9"]).run()
    ((study, plan, out, execution, again),) = asked
    assert (plan.seed, plan.quick, plan.config.strategy.dust_range) == (7, False, 0.9)
    assert (out, execution, again) == (Path("there"), Execution("planar", 2), True)
    sample = [entry.labels for entry in study.entries(plan) if entry.labels["reading"] is None]
    assert len(sample) == 40 * 3 * len(SETTINGS) and {labels["repeat"] for labels in sample} == {0, 1, 2}


@pytest.mark.parametrize("number", [0, 19, 100_001])
def test_the_help_states_the_limits_that_hold(number, capsys):
    with pytest.raises(SystemExit):
        main(["infer", "--combinations", str(number)])
    assert f"--combinations must be a whole number between 20 and 100000 (got {number})" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        main(["infer", "--help"])
    assert "between 20 and 100000; default 512" in capsys.readouterr().out
