"""What a run leaves behind: result.json, trajectory.npz and clean.rrd tell the same story."""

import json
from dataclasses import asdict
from unittest.mock import MagicMock

import numpy as np
import pytest
from support.rrd import read
from support.runs import first_step, records, run_of, spoil

from iswarm_mj.output.frames import BLOCK_FRAMES
from iswarm_mj.output.schema import ARRAYS
from iswarm_mj.output.trajectory import ABOUT, Scene
from iswarm_mj.strategy.genome import PRESETS, Genome
from iswarm_mj.tasks.measures import Measures
from iswarm_mj.utils.directory_lock import locked
from iswarm_mj.utils.errors import SimulationFault, UserError
from iswarm_mj.utils.units import ROBOT_DIAMETER
from iswarm_mj.workflows import clean as workflow
from iswarm_mj.workflows.clean import _save, run_swarm, summary

STEPS = BLOCK_FRAMES + 6

OF_A_RUN = ("version", "engine", "settings", "task", "genome", "config", "robot")


def run_to(config, record=True, steps=STEPS, **settings):
    """A run that stops when all balls are delivered; of several worlds the first is recorded."""
    return run_of(config, steps=steps, record_worlds=(0,) if record else (), **{"seed": 3, "goal": 24, **settings})


def run_clean(config, out, **settings):
    run = run_to(config, **settings)
    return run_swarm(run, out)


@pytest.fixture(scope="module")
def done(small, tmp_path_factory):
    """Directory, result.json, trajectory.npz, and the records of a run of the same seed."""
    out = tmp_path_factory.mktemp("results") / "new" / "folder"
    run_clean(small, out)
    run = run_to(small)
    recorded = [first_step(run.start), *records(run)]
    with np.load(out / "trajectory.npz") as file:
        return out, json.loads((out / "result.json").read_text()), dict(file), recorded


def timeless(content):
    return {name: value for name, value in content.items() if name not in ("wall_s", "seconds")}


def test_result_has_all_that_was_promised(done, small):
    out, content, _, recorded = done
    given = {"seed": 3, "engine": "mujoco", "n_robots": 30, "n_dust": 24, "max_steps": STEPS, "stop_at": 24}
    assert content.items() >= given.items()
    assert content["config"] == json.loads(json.dumps(asdict(small)))
    assert content["genome"] == asdict(PRESETS["type1"])
    balls = recorded[-1].swarm.task
    assert content["delivered"] == balls.is_delivered.sum() > 0
    assert content["picked"] == balls.was_picked.sum()
    assert content["collisions"] == recorded[-1].collisions[0] > 0
    assert content["mean_carriage_steps"] == pytest.approx(balls.carried_steps[balls.is_delivered].mean())
    assert content["steps"] == len(recorded) - 1
    points = 40 * content["delivered"] + 20 * (content["picked"] - content["delivered"])
    assert content["delivered"] < 24 and content["finished_at"] is None
    assert content["fitness"] == pytest.approx(points - content["collisions"] * 0.05 / 30)
    assert content["faults"] == content["devices"] == []
    assert content["wall_s"] > 0
    assert sorted(path.name for path in out.iterdir()) == ["clean.rrd", "result.json", "trajectory.npz"]


def test_trajectory_agrees_with_result(done):
    _, content, frames, _ = done
    memory = {f"{place}_{part}" for place in ("dust", "dump") for part in ("vector", "known", "hop")}
    assert frames.keys() == {*ARRAYS, *memory, *(f"scene_{name}" for name in Scene._fields), ABOUT}
    about = json.loads(frames[ABOUT].item())
    assert about == {name: content[name] for name in OF_A_RUN}
    np.testing.assert_array_equal(frames["step"], np.arange(content["steps"] + 1))
    for name in ("delivered", "picked", "collisions"):
        assert frames[name][-1] == content[name] and frames[name][0] == 0
        assert (np.diff(frames[name]) >= 0).all()
    np.testing.assert_array_equal((frames["ball_state"] == 2).sum(axis=1), frames["delivered"])
    np.testing.assert_array_equal((frames["ball_state"] == 1).sum(axis=1), frames["is_loaded"].sum(axis=1))


def test_scene(done):
    _, _, frames, recorded = done
    assert frames["scene_arena_size"] == pytest.approx(15 * ROBOT_DIAMETER)
    np.testing.assert_allclose(frames["scene_dump"] / ROBOT_DIAMETER, [-1.5, -1.5, 1.5, 1.5])
    areas = [[-6.5, -1.5, -3.5, 1.5], [3.5, -1.5, 6.5, 1.5]]
    np.testing.assert_allclose(frames["scene_dust_areas"] / ROBOT_DIAMETER, areas)
    np.testing.assert_allclose(frames["scene_robot_size"][-1], [2e-3, 2e-3, 1e-3])
    assert frames["scene_is_scout"].sum() == 2 and frames["scene_control_period"] == 1.0
    np.testing.assert_array_equal(frames["scene_ball_radius"], recorded[0].swarm.task.radius[0])
    centres = frames["ball_position"][0, :, :2] / ROBOT_DIAMETER
    for x_min, y_min, x_max, y_max in areas:
        assert ((centres >= [x_min, y_min]) & (centres <= [x_max, y_max])).all(axis=1).sum() == 12


def test_same_seed_same_result_without_a_recording_and_at_another_number_of_threads(done, small, tmp_path):
    content = run_clean(small, tmp_path, record=False, threads=2)
    assert timeless(content) == timeless(done[1])
    assert json.loads((tmp_path / "result.json").read_text()) == content
    assert [path.name for path in tmp_path.iterdir()] == ["result.json"]


def test_the_summary_names_the_strategy_and_what_another_task_with_balls_measures(done):
    """And of cleaning what it does: balls; not of a task that has them, which may never deliver any."""
    content = done[1]
    preset, own = asdict(Genome()), asdict(Genome(p_vector_forget=0.5))
    changed = {"task": {"class": "Sort"}, "strategy": {"class": "BySize"}, "metrics": {"sorted": 0.75}}
    for change, told, untold in (
        ({"genome": preset}, ("strategy  type1", "delivered"), "sorted"),
        ({"genome": own}, ("strategy  own genome", "fitness"), "sorted"),
        (changed, ("strategy  BySize", "task  Sort", "sorted  0.75"), "delivered"),
    ):
        text = summary(content | change, done[0])
        assert all(part in text for part in told) and untold not in text


def test_of_many_worlds_the_summary_states_averages_and_ranges(done):
    """Ten are listed one by one."""
    listed = {
        "n_worlds": 12,
        "delivered": [*range(12)],
        "finished_at": [None] * 10 + [20, 30],
        "collisions": [None] * 12,
    }
    told = summary(done[1] | listed, done[0]).splitlines()
    assert told[0].endswith("in 12 world(s), seed 3; averages and ranges")
    assert "  5.5 (0 to 11) of " in told[3] and "step 25.0 (20 to 30) in 2 worlds (goal" in told[4]
    assert told[6].endswith("collisions  -")
    told = summary(done[1] | listed | {"mean_carriage_steps": [None, 33.0, 241.0, *[134.0] * 9]}, done[0])
    assert "carriage  134.5 (33 to 241) steps on average in 11 worlds\n" in told
    told = summary(done[1] | {"n_worlds": 10, "collisions": [*range(10)]}, done[0])
    assert "0, 1, 2, 3, 4, 5, 6, 7, 8, 9" in told and "to 9" not in told


def test_old_results_go(small, tmp_path):
    for name in ("clean.rrd", "trajectory.npz", "result.json", "notes.txt"):
        (tmp_path / name).write_text("old")
    run_clean(small, tmp_path, record=False, steps=1)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["notes.txt", "result.json"]
    assert json.loads((tmp_path / "result.json").read_text())["steps"] == 1


def test_a_further_world_has_its_directory_for_itself(small, tmp_path, monkeypatch):
    out, advance, refused = tmp_path / "out", workflow._advance, []

    def other_run(*given):
        with pytest.raises(UserError, match=r"world-1 is in use by another process"), locked(out / "world-1"):
            pass
        refused.append(True)
        advance(*given)

    monkeypatch.setattr(workflow, "_advance", other_run)
    run_swarm(run_of(small, steps=1, worlds=2, record_worlds=(0, 1)), out)
    assert refused == [True]
    assert sorted(path.name for path in (out / "world-1").iterdir()) == ["clean.rrd", "trajectory.npz"]


def test_of_a_run_that_ends_within_a_program_no_measures_are_kept(small, tmp_path, monkeypatch):
    """The program has taken the state of the worlds; what was written before is of an earlier step."""
    run = run_to(small, record=False)
    _save(run, tmp_path, 0.0, {})
    before = json.loads((tmp_path / "result.json").read_text())
    monkeypatch.setattr(run, "metrics", MagicMock(side_effect=RuntimeError("deleted")))
    run.advance()
    _save(run, tmp_path, 0.0, {"interrupted": True})
    after = json.loads((tmp_path / "result.json").read_text())
    gone = dict.fromkeys([*Measures._fields, "fitness", "metrics"])
    assert after == before | gone | {"steps": 1, "interrupted": True}


class TestFaults:
    """Robot 5 is far outside in step 66, after one block of frames was written and before the second is full."""

    STEP = BLOCK_FRAMES + 2

    @pytest.fixture(autouse=True)
    def elsewhere(self, tmp_path, monkeypatch):
        monkeypatch.chdir(tmp_path)  # MuJoCo logs to the working directory

    def test_all_files_are_written_and_the_fault_is_raised(self, done, small, tmp_path):
        run = run_to(small)
        spoil(run, self.STEP, world=0, robot=5)
        with pytest.raises(SimulationFault, match=r"^step 66, world 0: robot 5 left the arena; ") as raised:
            run_swarm(run, tmp_path)
        assert sorted(path.name for path in tmp_path.iterdir()) == ["clean.rrd", "result.json", "trajectory.npz"]
        content = json.loads((tmp_path / "result.json").read_text())
        assert content["faults"] == [str(raised.value)] and content["steps"] == self.STEP
        assert content["finished_at"] is None and content["collisions"] > 0
        with np.load(tmp_path / "trajectory.npz") as file:
            frames = dict(file)
        assert frames["step"].tolist() == list(range(self.STEP + 1))
        np.testing.assert_array_equal(frames["pose"][:-1], done[2]["pose"][: self.STEP])
        np.testing.assert_array_equal(frames["pose"][-1], frames["pose"][-2])  # the step that failed moves nobody
        assert frames["mean_speed"][-1] == 0 and frames["collisions"][-1] == frames["collisions"][-2]
        recorded = read(tmp_path / "clean.rrd")["/world/robots/body"]
        assert recorded["step"] == list(range(self.STEP + 1))
        centres = np.array(recorded["Boxes3D:centers"])
        np.testing.assert_allclose(centres[..., :2], 1e3 * frames["pose"][..., :2], atol=1e-4)
