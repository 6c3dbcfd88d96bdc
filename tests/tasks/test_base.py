"""A task outside the package: it runs on every engine, and what is wrong with one is said in a
sentence."""

import json
from typing import ClassVar

import jax.numpy as jnp
import numpy as np
import pytest
from support.mjx import ran
from support.rrd import read
from support.tasks import Eastward

from iswarm_mj.engines.mujoco.settings import MujocoSettings
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.output.loading import load
from iswarm_mj.paper.report.inspection import describe_directory
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.scenario import Scenario
from iswarm_mj.strategy.base import Strategy
from iswarm_mj.strategy.interface import Command
from iswarm_mj.tasks.base import Quantity
from iswarm_mj.utils.errors import UserError
from iswarm_mj.workflows.clean import run_swarm

ENGINES = [PlanarSettings(1), PlanarSettings(impl="warp", chunk=4)]
N = 6


class Homing(Strategy):
    """Robots that turn to the east and walk until they feel that they are beyond the line."""

    recorded = ("gap",)

    def init(self, n_robots, key):
        return {"gap": jnp.zeros(n_robots), "yaw": jnp.full(n_robots, jnp.nan)}

    def picks(self, memory):
        return memory["gap"] > jnp.inf

    def act(self, memory, seen, key):
        gap = seen.sensed["gap"]
        ahead = jnp.where((gap > 0) & (gap <= memory["gap"]), 1.2, 0.2)
        turn = jnp.where(gap > memory["gap"], 0.5, 0.1)
        return {"gap": gap, "yaw": memory["yaw"]}, Command(turn, ahead)


def run_of(small, engine, task=None, **settings):
    options = {
        name: settings.pop(name) for name in ("record_worlds", "capacity") if name in settings
    }
    fields = {
        "strategy": Homing(),
        "task": task or Eastward(2.0),
        "robots": N,
        "steps": 12,
        "worlds": 2,
    }
    return Run(Scenario(small, engine=engine, **fields | settings), **options)


@pytest.mark.parametrize("engine", ENGINES, ids=["planar", "warp"])
def test_runs_on_every_engine(small, engine):
    """Robots sense, and the task counts, where they were as each step began."""
    run = run_of(small, engine, record_worlds=(0, 1))
    start, record = run.start.poses[0], ran(run)
    before = np.concatenate([start[None], record.poses[:-1]])[..., 0]
    np.testing.assert_allclose(record.swarm.memory["gap"], 2.0 - before, atol=1e-5)
    is_east = before > 2.0
    np.testing.assert_array_equal(record.swarm.task["is_east"], is_east)
    assert is_east[-1].sum() not in (0, 2 * N)
    for world in range(2):
        assert run.progress()[world] == is_east[-1, world].sum()
        assert run.metrics()["share"][world] == pytest.approx(is_east[-1, world].mean())
    assert run.metrics()["steps"].tolist() == [12, 12]


def test_ends_at_its_goal(small):
    """All robots are east of the western wall from the first step on, and of three of them that is
    enough here."""
    for stop_at in (None, 3):
        run = run_of(small, MujocoSettings(1), Eastward(-20.0), goal=stop_at)
        ran(run)
        assert run.goal == (stop_at or N)
        assert [run.measures(world).finished_at for world in range(2)] == [1, 1]


def test_settings_change_no_program(small):
    """Numbers of a task are arrays of a program; with another line the same one runs."""
    from iswarm_mj.simulation.decide import decide_packed

    ran(run_of(small, MujocoSettings(1), Eastward(1.0)))
    before = decide_packed._cache_size()
    ran(run_of(small, MujocoSettings(1), Eastward(3.0)))
    assert decide_packed._cache_size() == before


def changed(**methods):
    return type("Eastward", (Eastward,), methods)(0.0)


def advancing(change):
    """A task whose `advance` returns something else."""
    return changed(advance=lambda self, *given: change(*Eastward.advance(self, *given)))


WRONG = {
    "no areas": (changed(areas=None), "Eastward has no method areas"),
    "nowhere": (
        changed(
            lay_out=lambda self, c, n, *a: (
                np.full((n, 3), np.nan),
                Eastward.lay_out(self, c, n, *a)[1],
            )
        ),
        r"robots first \(got numbers that are not\)",
    ),
    "state alone": (
        advancing(lambda own, sensed: own),
        r"must return its state and Sensed \(got a dict\)",
    ),
    "sensed": (
        advancing(lambda own, sensed: (own, sensed._replace(is_busy=jnp.zeros(N)))),
        r"must return bool\[6\] as \.is_busy of its sensed \(got float32\[6\]\)",
    ),
    "sensed by three": (
        advancing(lambda own, sensed: (own, sensed._replace(own={"gap": jnp.zeros(3)}))),
        r"must return gap of 6 robots first \(got shape \(3,\)\)",
    ),
    "no method": (changed(reward=None), "Eastward has no method reward; a task has it, see Task"),
    "the class": (
        Eastward,
        r"task is the class Eastward itself; give an object of it, as Eastward\(\)",
    ),
    "poses": (
        changed(
            lay_out=lambda self, c, n, *a: (np.zeros((n, 2)), Eastward.lay_out(self, c, n, *a)[1]),
        ),
        r"Eastward.lay_out must return finite poses \(N, 3\) of the 6 robots first "
        r"\(got float64\[6, 2\]\)",
    ),
    "text in the state": (
        changed(
            lay_out=lambda self, c, n, *a: (
                Eastward.lay_out(self, c, n, *a)[0],
                {"is_east": "yes"},
            ),
        ),
        r"Eastward.lay_out must return arrays and numbers as its state "
        r"\(got a str as \['is_east'\]\)",
    ),
    "goal": (
        changed(goal=lambda self, c, n: 0.5),
        r"Eastward.goal must return a whole number above 0, or None \(got",
    ),
    "state": (
        advancing(lambda own, sensed: (3, sensed)),
        r"Eastward.advance must return dict of 2 arrays as its state",
    ),
    "senses": (
        changed(senses={"light": Quantity("of the sun")}),
        r"Eastward.advance must return by name what senses declares, light \(got gap\)",
    ),
    "progress": (
        changed(progress=lambda self, t: t["is_east"].mean()),
        r"Eastward.progress must return int32\[\] as its result \(got float32\[\]\)",
    ),
    "dtype of reward": (
        changed(reward=lambda self, b, after, a: after["is_east"]),
        r"Eastward.reward must return float32\[6\] as its result \(got bool\[6\]\)",
    ),
    "shape of metrics": (
        changed(metrics=lambda self, t: {"share": t["is_east"], "steps": t["steps"]}),
        r"Eastward.metrics must return share as a scalar float32, int32 or bool \(got bool\[6\]\)",
    ),
    "metrics": (
        changed(metrics=lambda self, t: t["steps"]),
        r"Eastward.metrics must return by name what measured declares, share, steps \(got a ",
    ),
    "areas": (
        changed(areas=lambda self, c, t: {"east": jnp.zeros(3)}),
        r"Eastward.areas must return east as numbers \(M, 3\) \(got shape \(3,\)\)",
    ),
    "control flow": (
        changed(progress=lambda self, t: jnp.int32(1) if t["is_east"].any() else jnp.int32(0)),
        r"Eastward.progress raised TracerBoolConversionError.*"
        r"jax.errors.TracerBoolConversionError explains",
    ),
}


@pytest.mark.parametrize("task, sentence", WRONG.values(), ids=WRONG)
def test_wrong_tasks_are_refused(small, task, sentence):
    with pytest.raises(UserError, match=sentence):
        run_of(small, MujocoSettings(1), task)


def test_what_no_task_offers(small):
    """Cleaning has no gap to sense."""
    sentence = r"Homing.act reads sensed\['gap'\] .* but of its own the task offers nothing"
    with pytest.raises(UserError, match=sentence):
        Run(Scenario(small, strategy=Homing(), robots=N, engine=MujocoSettings(1), steps=12))


class TestFiles:
    """Files of a run of another task, written and read back."""

    @pytest.fixture(scope="class")
    @classmethod
    def saved(cls, small, tmp_path_factory):
        out = tmp_path_factory.mktemp("run")
        run = run_of(small, PlanarSettings(1), record_worlds=(0, 1))
        run_swarm(run, out)
        return out, load(out)

    def test_result(self, saved):
        out, run = saved
        content = json.loads((out / "result.json").read_text())
        assert content["task"] == run.result["task"] == {"class": "Eastward", "line": 2.0}
        assert not {"delivered", "fitness", "n_dust"} & content.keys() and content["stop_at"] == N
        assert content["metrics"]["steps"] == [12, 12]

    def test_the_summary_states_units(self, small, tmp_path, capsys):
        class Counted(Eastward):
            measured: ClassVar = {**Eastward.measured, "steps": Quantity("taken", "steps")}

        run = run_of(small, PlanarSettings(1), Counted(2.0))
        run_swarm(run, tmp_path)
        text = capsys.readouterr().out
        assert "       steps  12, 12 steps\n" in text and "       share  0" in text
        assert "       steps  12, 12 steps\n" in describe_directory(tmp_path)

    def test_metrics_of_each_step(self, saved):
        """The share that was counted in a step is that of the robots as the step began."""
        _, run = saved
        steps, robots = run.steps.to_pydict(), run.robots.to_pydict()
        x = np.array(robots["x"]).reshape(2, 13, N)
        shares = np.array(steps["share"]).reshape(2, 13)
        np.testing.assert_allclose(shares[:, 1:], (x[:, :-1] > 2e-3).mean(axis=-1), atol=1e-6)
        np.testing.assert_allclose(shares[:, -1], run.result["metrics"]["share"], atol=1e-6)
        assert run.steps.schema.field("share").metadata[b"unit"] == b""

    def test_recording(self, saved):
        """Areas are drawn where the task has them, and neither dump nor dust; metrics are time
        series."""
        out, run = saved
        columns = read(out / "run.rrd")
        boxes = columns["/world/arena/east"]
        assert boxes["Boxes3D:centers"][3][0][:2] == pytest.approx([7.0, 0.0], abs=1e-5)
        assert boxes["Boxes3D:half_sizes"][3][0][:2] == pytest.approx([5.0, 5.0], abs=1e-5)
        drawn = {entity for entity in columns if entity.startswith("/world/arena")}
        assert drawn == {f"/world/arena/{name}" for name in ("floor", "walls", "east")}
        series = np.ravel(columns["/series/task/share"]["Scalars:scalars"])
        np.testing.assert_allclose(series, run.steps.to_pydict()["share"][:13])
