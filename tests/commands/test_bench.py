"""A benchmark counts the steps and worlds that it timed and prints them as one line of JSON."""

import json
import time
from types import SimpleNamespace

import pytest
from support.tasks import Eastward

from iswarm_mj.commands import bench as command
from iswarm_mj.commands.bench import _time, bench
from iswarm_mj.commands.main import parse
from iswarm_mj.engines.mujoco.settings import MujocoSettings
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.scenario import Scenario

N_ROBOTS, N_WORLDS, WARM_UP, STEPS = 30, 3, 2, 5


@pytest.mark.parametrize(
    "engine", [MujocoSettings(1), PlanarSettings(1, refinement=3)], ids=["mujoco", "planar"]
)
def test_counts_and_keys(small, engine, capfd):
    scenario = Scenario(
        small, robots=N_ROBOTS, engine=engine, worlds=N_WORLDS, steps=WARM_UP + STEPS
    )
    content = bench(Run(scenario, record_worlds=()), WARM_UP)
    out = capfd.readouterr().out
    assert out.count("\n") == 1 and json.loads(out) == json.loads(json.dumps(content))
    counted = {name: content[name] for name in (*engine.identity, "n_robots", "n_worlds", "steps")}
    assert counted == {
        **engine.identity,
        "n_robots": N_ROBOTS,
        "n_worlds": N_WORLDS,
        "steps": STEPS,
    }
    stages = {name for name in content if name.endswith("_ms")}
    assert stages == {"sense_ms", "policy_ms", "physics_ms"} and all(
        content[stage] > 0 for stage in stages
    )
    assert content["devices"] == [] and content["delivered_mean"] == 0
    rate = N_WORLDS * N_ROBOTS * (small.drive.turn_substeps + small.drive.walk_substeps)
    rate *= content.get("refinement", 1)
    assert content["robot_physics_steps_per_s"] == pytest.approx(
        1e3 * rate / content["ms_per_step"], rel=0.01
    )


class Short(Eastward):
    """Ends after five control steps."""

    def goal(self, config, n_robots):
        return 5

    def progress(self, state):
        return state["steps"]


def test_a_run_that_ends_early_has_fewer_steps(small, monkeypatch):
    """Of calls that take 0.1, 0.2 and 0.6 s."""
    monkeypatch.setattr(command, "_time", lambda *given: (_time(*given)[0], [0.1, 0.2, 0.6]))
    scenario = Scenario(small, task=Short(), robots=N_ROBOTS, engine=PlanarSettings(1), steps=20)
    content = bench(Run(scenario, record_worlds=()), WARM_UP)
    assert content["steps"] == 5 - WARM_UP and content["delivered_mean"] == 5
    assert (content["ms_per_step"], content["ms_per_step_mean"]) == (200, 300)


def test_compiled_programs_take_whole_chunks(monkeypatch):
    made = []
    monkeypatch.setattr(command, "bench", lambda run, warm_up: made.append((*run, warm_up)))
    monkeypatch.setattr(command, "run_of", lambda scenario: (scenario.engine.chunk, scenario.steps))
    parse(["bench", "--engine=mjx", "--chunk=6", "--steps=20", "--warm-up=7", "--robots=9"]).run()
    assert made == [(6, 12 + 24, 12)]


def test_times_are_those_of_a_control_step(monkeypatch):
    """Each call takes four steps and 0.2 s, the first one 3 s."""
    run, clock = SimpleNamespace(step=0, is_over=False, watch=SimpleNamespace(laps=[])), [0.0]

    def advance():
        clock[0] += 0.2 if run.step else 3.0
        run.step += 4
        run.is_over = run.step == 12

    run.advance = advance
    monkeypatch.setattr(time, "perf_counter", lambda: clock[0])
    first_call_s, laps = _time(run, 4)
    assert first_call_s == 3.0 and laps == pytest.approx([0.05, 0.05])
