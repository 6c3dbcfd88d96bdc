"""Files of a run: result.json, trajectory.npz and clean.rrd tell the same story."""

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
from iswarm_mj.workflows.clean import run_swarm, summary

STEPS = BLOCK_FRAMES + 6
N_BALLS = 24
N_ROBOTS = 30
FILES = ["clean.rrd", "result.json", "trajectory.npz"]
DESCRIPTION = ("version", "engine", "refinement", "settings", "task", "genome", "config", "robot")
"""Entries of result.json that describe the run, which trajectories have, too."""
HELD = 1
DELIVERED = 2


def small_run(config, record=True, steps=STEPS, **settings):
    """Run that stops when all balls are delivered; of several worlds the first is recorded."""
    recorded = (0,) if record else ()
    return run_of(
        config, steps=steps, record_worlds=recorded, **{"seed": 3, "goal": N_BALLS, **settings}
    )


def read_result(directory):
    return json.loads((directory / "result.json").read_text())


def names_in(directory):
    return sorted(path.name for path in directory.iterdir())


@pytest.fixture(scope="module")
def out(small, tmp_path_factory):
    """Directory of a run, which did not exist before."""
    out = tmp_path_factory.mktemp("results") / "new" / "folder"
    run_swarm(small_run(small), out)
    return out


@pytest.fixture(scope="module")
def content(out):
    return read_result(out)


@pytest.fixture(scope="module")
def frames(out):
    with np.load(out / "trajectory.npz") as file:
        return dict(file)


@pytest.fixture(scope="module")
def all_records(small):
    """Records of all steps of a run of the same seed, the start included."""
    run = small_run(small)
    return [first_step(run.start), *records(run)]


class TestResult:
    def test_it_describes_the_run(self, content, small):
        assert content["seed"] == 3 and content["engine"] == "mujoco"
        assert content["n_robots"] == N_ROBOTS and content["n_dust"] == N_BALLS
        assert content["max_steps"] == STEPS and content["stop_at"] == N_BALLS
        assert content["config"] == json.loads(json.dumps(asdict(small)))
        assert content["genome"] == asdict(PRESETS["type1"])
        assert content["faults"] == content["devices"] == []
        assert content["wall_s"] > 0

    def test_measures_are_those_of_the_last_record(self, content, all_records):
        last = all_records[-1]
        balls = last.swarm.task
        assert content["steps"] == len(all_records) - 1
        assert content["delivered"] == balls.is_delivered.sum() > 0
        assert content["picked"] == balls.was_picked.sum()
        assert content["collisions"] == last.collisions[0] > 0
        carriage = balls.carried_steps[balls.is_delivered].mean()
        assert content["mean_carriage_steps"] == pytest.approx(carriage)

    def test_fitness_rewards_balls_and_punishes_collisions(self, content):
        assert content["delivered"] < N_BALLS and content["finished_at"] is None
        n_carried = content["picked"] - content["delivered"]
        points = 40 * content["delivered"] + 20 * n_carried
        punishment = content["collisions"] * 0.05 / N_ROBOTS
        assert content["fitness"] == pytest.approx(points - punishment)

    def test_there_are_no_other_files(self, out):
        assert names_in(out) == FILES


class TestTrajectory:
    def test_it_has_all_quantities_and_the_description_of_the_run(self, content, frames):
        memory = {
            f"{place}_{part}" for place in ("dust", "dump") for part in ("vector", "known", "hop")
        }
        scene = {f"scene_{name}" for name in Scene._fields}
        assert frames.keys() == {*ARRAYS, *memory, *scene, ABOUT}
        about = json.loads(frames[ABOUT].item())
        assert about == {name: content[name] for name in DESCRIPTION}

    def test_counts_agree_with_the_result(self, content, frames):
        np.testing.assert_array_equal(frames["step"], np.arange(content["steps"] + 1))
        for name in ("delivered", "picked", "collisions"):
            assert frames[name][0] == 0 and frames[name][-1] == content[name]
            assert (np.diff(frames[name]) >= 0).all()

    def test_counts_agree_with_the_states_of_balls(self, frames):
        states = frames["ball_state"]
        n_delivered = (states == DELIVERED).sum(axis=1)
        np.testing.assert_array_equal(n_delivered, frames["delivered"])
        n_held = (states == HELD).sum(axis=1)
        np.testing.assert_array_equal(n_held, frames["is_loaded"].sum(axis=1))

    def test_its_scene_is_the_small_arena(self, frames, all_records):
        assert frames["scene_arena_size"] == pytest.approx(15 * ROBOT_DIAMETER)
        dump = frames["scene_dump"] / ROBOT_DIAMETER
        np.testing.assert_allclose(dump, [-1.5, -1.5, 1.5, 1.5])
        np.testing.assert_allclose(frames["scene_robot_size"][-1], [2e-3, 2e-3, 1e-3])
        assert frames["scene_is_scout"].sum() == 2 and frames["scene_control_period"] == 1.0
        radius = all_records[0].swarm.task.radius[0]
        np.testing.assert_array_equal(frames["scene_ball_radius"], radius)

    def test_half_of_the_balls_start_in_each_dust_area(self, frames):
        areas = [[-6.5, -1.5, -3.5, 1.5], [3.5, -1.5, 6.5, 1.5]]
        np.testing.assert_allclose(frames["scene_dust_areas"] / ROBOT_DIAMETER, areas)
        centres = frames["ball_position"][0, :, :2] / ROBOT_DIAMETER
        for x_min, y_min, x_max, y_max in areas:
            is_inside = (centres >= [x_min, y_min]) & (centres <= [x_max, y_max])
            assert is_inside.all(axis=1).sum() == N_BALLS / 2


def test_results_depend_neither_on_recordings_nor_on_threads(content, small, tmp_path):
    again = run_swarm(small_run(small, record=False, threads=2), tmp_path)
    durations = ("wall_s", "seconds")
    for name in content.keys() | again.keys():
        if name not in durations:
            assert again[name] == content[name], name
    assert read_result(tmp_path) == again
    assert names_in(tmp_path) == ["result.json"]


class TestSummary:
    @pytest.fixture
    def lines(self, content, out):
        """Function that returns the lines of the summary of changed results, not indented."""

        def lines_of(**changes):
            return [line.strip() for line in summary(content | changes, out).splitlines()]

        return lines_of

    @pytest.mark.parametrize(
        ("genome", "name"),
        [(Genome(), "type1"), (Genome(p_vector_forget=0.5), "own genome")],
    )
    def test_it_names_the_genome_and_counts_balls(self, lines, genome, name):
        shown = lines(genome=asdict(genome))
        assert f"strategy  {name}" in shown
        names = {line.split("  ")[0] for line in shown}
        assert {"delivered", "fitness"} <= names and "sorted" not in names

    def test_it_has_the_metrics_of_another_task_with_balls(self, lines):
        """Such a task may never deliver any ball."""
        shown = lines(
            task={"class": "Sort"}, strategy={"class": "BySize"}, metrics={"sorted": 0.75}
        )
        for line in ("strategy  BySize", "task  Sort", "sorted  0.75"):
            assert line in shown
        assert not any("delivered" in line for line in shown)

    def test_it_names_failures_and_the_tip_of_runs_that_have_them(self, lines, content):
        shown = lines()
        assert not any(line.startswith(("failing", "tip")) for line in shown)

        settings = content["settings"] | {"failing": "0.25:100"}
        gripper = content["config"]["gripper"] | {"tip": "ring.json"}
        config = content["config"] | {"gripper": gripper}
        shown = lines(n_robots=60, settings=settings, config=config)
        assert "failing  15 of 60 robots after step 100" in shown
        assert "tip  ring.json" in shown

    def test_ten_worlds_are_listed_one_by_one(self, lines):
        shown = lines(n_worlds=10, collisions=[*range(10)])
        assert "collisions  0, 1, 2, 3, 4, 5, 6, 7, 8, 9" in shown

    def test_of_more_worlds_there_are_averages_and_ranges(self, lines):
        """Numbers may be undefined in some worlds, or in all."""
        shown = lines(
            n_worlds=12,
            delivered=[*range(12)],
            finished_at=[None] * 10 + [20, 30],
            mean_carriage_steps=[None, 33.0, 241.0, *[134.0] * 9],
            collisions=[None] * 12,
        )
        assert shown[0].endswith("in 12 world(s), seed 3; averages and ranges")
        assert shown[3].startswith("delivered  5.5 (0 to 11) of ")
        assert "step 25.0 (20 to 30) in 2 worlds (goal" in shown[4]
        assert shown[5] == "carriage  134.5 (33 to 241) steps on average in 11 worlds"
        assert shown[6] == "collisions  -"


def test_results_of_an_earlier_run_are_removed(small, tmp_path):
    """But no other files."""
    for name in (*FILES, "notes.txt"):
        (tmp_path / name).write_text("old")
    run_swarm(small_run(small, record=False, steps=1), tmp_path)
    assert names_in(tmp_path) == ["notes.txt", "result.json"]
    assert read_result(tmp_path)["steps"] == 1


def test_a_further_world_has_its_directory_for_itself(small, tmp_path, monkeypatch):
    """Another run that would write into it meanwhile is refused."""
    out = tmp_path / "out"
    run = run_of(small, steps=1, worlds=2, record_worlds=(0, 1))
    advance = run.advance
    calls = []

    def try_other_run_and_advance():
        in_use = r"world-1 is in use by another process"
        with pytest.raises(UserError, match=in_use), locked(out / "world-1"):
            pass
        calls.append(1)
        return advance()

    monkeypatch.setattr(run, "advance", try_other_run_and_advance)
    run_swarm(run, out)
    assert len(calls) == 1
    assert names_in(out / "world-1") == ["clean.rrd", "trajectory.npz"]


def test_a_run_that_ends_within_a_program_keeps_no_measures(small, tmp_path, monkeypatch):
    """The program has taken the state of the worlds; measures written before are outdated."""
    run = small_run(small, record=False)
    advance = run.advance
    results = []

    def advance_and_interrupt():
        results.append(read_result(tmp_path))
        advance()
        monkeypatch.setattr(run, "metrics", MagicMock(side_effect=RuntimeError("deleted")))
        raise KeyboardInterrupt

    monkeypatch.setattr(run, "advance", advance_and_interrupt)
    with pytest.raises(KeyboardInterrupt):
        run_swarm(run, tmp_path)
    (before,) = results
    removed = dict.fromkeys([*Measures._fields, "fitness", "metrics"])
    assert before["fitness"] is not None
    assert read_result(tmp_path) == before | removed | {"steps": 1, "interrupted": True}


class TestFault:
    """Robot 5 is far outside in a step in which the second block of frames is not yet full."""

    STEP = BLOCK_FRAMES + 2

    @pytest.fixture(scope="class")
    @classmethod
    def fault(cls, small, tmp_path_factory):
        """Directory of the run, and the fault that it raised."""
        out = tmp_path_factory.mktemp("fault")
        run = small_run(small)
        spoil(run, cls.STEP, world=0, robot=5)
        with pytest.MonkeyPatch.context() as patch:
            patch.chdir(out.parent)  # MuJoCo logs to the working directory
            message = r"^step 66, world 0: robot 5 left the arena; "
            with pytest.raises(SimulationFault, match=message) as raised:
                run_swarm(run, out)
        return out, raised.value

    @pytest.fixture(scope="class")
    @classmethod
    def spoilt_frames(cls, fault):
        out, _ = fault
        with np.load(out / "trajectory.npz") as file:
            return dict(file)

    def test_the_result_states_it(self, fault):
        out, raised = fault
        assert names_in(out) == FILES
        result = read_result(out)
        assert result["faults"] == [str(raised)] and result["steps"] == self.STEP
        assert result["finished_at"] is None and result["collisions"] > 0

    def test_the_step_that_failed_moves_nobody(self, spoilt_frames, frames):
        assert spoilt_frames["step"].tolist() == list(range(self.STEP + 1))
        pose = spoilt_frames["pose"]
        np.testing.assert_array_equal(pose[:-1], frames["pose"][: self.STEP])
        np.testing.assert_array_equal(pose[-1], pose[-2])
        assert spoilt_frames["mean_speed"][-1] == 0
        assert spoilt_frames["collisions"][-1] == spoilt_frames["collisions"][-2]

    def test_the_recording_has_all_steps(self, fault, spoilt_frames):
        out, _ = fault
        robots = read(out / "clean.rrd")["/world/robots/body"]
        assert robots["step"] == list(range(self.STEP + 1))
        centres = np.array(robots["Boxes3D:centers"])
        expected = 1e3 * spoilt_frames["pose"][..., :2]
        np.testing.assert_allclose(centres[..., :2], expected, atol=1e-4)
