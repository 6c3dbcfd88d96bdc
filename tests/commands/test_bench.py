"""A benchmark counts the steps and worlds that it timed and prints them as one line of JSON."""

import json
import time
from types import SimpleNamespace

import pytest
from support.tasks import Eastward

from iswarm_mj.commands import bench as command
from iswarm_mj.commands.bench import bench
from iswarm_mj.commands.main import parse
from iswarm_mj.engines.mujoco.settings import MujocoSettings
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.scenario import Scenario

N_ROBOTS = 30
N_WORLDS = 3
WARM_UP = 2
N_STEPS = 5


@pytest.mark.parametrize(
    "engine",
    [
        pytest.param(MujocoSettings(1), marks=pytest.mark.slow, id="mujoco"),
        pytest.param(PlanarSettings(1, refinement=3), id="planar"),
    ],
)
def test_counts_and_keys(small, engine, capfd):
    scenario = Scenario(
        small, robots=N_ROBOTS, engine=engine, worlds=N_WORLDS, steps=WARM_UP + N_STEPS
    )
    times = bench(Run(scenario, record_worlds=()), WARM_UP)
    output = capfd.readouterr().out
    assert output.count("\n") == 1
    assert json.loads(output) == json.loads(json.dumps(times))

    assert times.items() >= engine.identity.items()
    assert (times["n_robots"], times["n_worlds"], times["steps"]) == (N_ROBOTS, N_WORLDS, N_STEPS)
    assert times["devices"] == []
    assert times["delivered_mean"] == 0

    stages = {name: value for name, value in times.items() if name.endswith("_ms")}
    assert set(stages) == {"sense_ms", "policy_ms", "physics_ms"}
    assert min(stages.values()) > 0

    n_substeps = 2 * small.drive.turn_substeps + small.drive.walk_substeps
    n_physics_steps = N_WORLDS * N_ROBOTS * n_substeps * times.get("refinement", 1)
    rate = n_physics_steps / (1e-3 * times["ms_per_step"])
    assert times["robot_physics_steps_per_s"] == pytest.approx(rate, rel=0.01)


class Short(Eastward):
    """A task that ends after five control steps."""

    def goal(self, config, n_robots):
        return 5

    def progress(self, state):
        return state["steps"]


def test_a_run_that_ends_early_has_fewer_steps(small, monkeypatch):
    """The time of a step is the median over calls, and their mean stands beside it."""

    def take_steps(run, warm_up):
        """Take all steps, and return 0.1, 0.2 and 0.6 s as the times of three."""
        first_call_s, _ = measure(run, warm_up)
        return first_call_s, [0.1, 0.2, 0.6]

    measure = command.time_steps
    monkeypatch.setattr(command, "time_steps", take_steps)
    scenario = Scenario(small, task=Short(), robots=N_ROBOTS, engine=PlanarSettings(1), steps=20)
    times = bench(Run(scenario, record_worlds=()), WARM_UP)
    assert times["steps"] == 5 - WARM_UP
    assert times["delivered_mean"] == 5
    assert (times["ms_per_step"], times["ms_per_step_mean"]) == (200, 300)


def test_compiled_programs_take_whole_chunks(monkeypatch):
    """With chunks of six steps, 20 steps are four chunks, and a warm-up of seven is two."""
    benches = []
    monkeypatch.setattr(command, "run_of", lambda scenario: scenario)
    monkeypatch.setattr(
        command, "bench", lambda scenario, warm_up: benches.append((scenario, warm_up))
    )
    parse(["bench", "--engine=mjx", "--chunk=6", "--steps=20", "--warm-up=7", "--robots=9"]).run()
    ((scenario, warm_up),) = benches
    assert scenario.engine.chunk == 6
    assert (scenario.steps, warm_up) == (12 + 24, 12)


class PretendedRun:
    """A run whose calls take four control steps each, and as long as they are told.

    Args:
        seconds: durations of its calls; after the last one it is over.
    """

    def __init__(self, seconds, clock):
        self.step = 0
        self.watch = SimpleNamespace(laps=[])
        self._seconds = list(seconds)
        self._clock = clock

    @property
    def is_over(self):
        return not self._seconds

    def advance(self):
        self._clock[0] += self._seconds.pop(0)
        self.step += 4


def test_times_are_those_of_a_control_step(monkeypatch):
    """The first call, which compiles, is the warm-up; the others take 0.1 and 0.4 s."""
    clock = [0.0]
    monkeypatch.setattr(time, "perf_counter", lambda: clock[0])
    first_call_s, laps = command.time_steps(PretendedRun([3.0, 0.1, 0.4], clock), 4)
    assert first_call_s == 3.0
    assert laps == pytest.approx([0.025, 0.1])
