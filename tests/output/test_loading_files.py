"""Loading the files of one run: units, incomplete files, and files that are no run."""

import json
from dataclasses import asdict

import numpy as np
import pyarrow.compute as pc
import pytest
from support.recorded import of_world, write_run
from support.rrd import read
from support.runs import run_of

import iswarm_mj
from iswarm_mj.config.swarm import INTERPRETATIONS, OpticsConfig, SwarmConfig
from iswarm_mj.output.offscreen import load_recorded
from iswarm_mj.output.trajectory import ABOUT, RECORDING, RESULT, TRAJECTORY
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.files import restored
from iswarm_mj.workflows.clean import run_swarm

LYING = 0
HELD = 1
DELIVERED = 2


VIEWS = []
"""Replacements of `AttemptView` of all recorded worlds."""


class Attempts(list):
    """Replacement of `AttemptView` that keeps the arguments of each call of `append`."""

    def __init__(self, *_):
        VIEWS.append(self)

    def append(self, *arguments):
        super().append(arguments)


@pytest.fixture(scope="module")
def small_run(small, tmp_path_factory):
    """Directory of a run of 30 robots, a fifth of them dead; its worlds end one after the other."""
    out = tmp_path_factory.mktemp("small")
    run = run_of(
        small,
        worlds=3,
        steps=60,
        seed=6,
        goal=1,
        failed_fraction=0.2,
        record_worlds=(1, 0),
    )
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("iswarm_mj.output.rerun_attempts.AttemptView", Attempts)
        run_swarm(run, out, grasps=9)
    return out


@pytest.mark.parametrize("index", [0, 1])
def test_attempts_are_shown_in_their_steps(small_run, index):
    """Those that succeeded are the changes of states of balls."""
    assert len(VIEWS) == 2
    view = VIEWS[index]
    directory = (small_run, small_run / "world-0")[index]
    with np.load(directory / TRAJECTORY) as file:
        states = file["ball_state"]
        positions = 1e3 * file["ball_position"]

    assert [step for step, *_ in view] == list(range(1, len(states)))
    for step, attempts, balls in view:
        before = states[step - 1]
        after = states[step]
        lifted = np.flatnonzero((before == LYING) & (after == HELD))
        released = np.flatnonzero((before == HELD) & (after == DELIVERED))
        for is_lift, changed in ((True, lifted), (False, released)):
            succeeded = [
                tried.ball for tried in attempts if tried.is_lift == is_lift and tried.succeeded
            ]
            assert succeeded == changed.tolist()
        on_floor = after != HELD
        np.testing.assert_allclose(balls[on_floor], positions[step, on_floor, :2], atol=1e-4)
    assert sum(len(attempts) for _, attempts, _ in view) > 3


class TestTables:
    """Rows of robots that are dead, and of worlds that have ended."""

    @pytest.fixture
    def loaded(self, small_run):
        return iswarm_mj.load(small_run)

    def test_the_dead_send_and_do_nothing(self, loaded):
        assert loaded.settings.failed_fraction == 0.2
        dead = loaded.robots.filter(~pc.field("is_alive"))
        assert dead.num_rows == loaded.robots.num_rows // 5
        assert dead["message"].null_count == dead.num_rows
        assert set(dead["forward"].drop_null().to_pylist()) == {0.0}

    def test_worlds_end_one_after_the_other(self, loaded):
        ends = loaded.result["finished_at"]
        assert None not in ends[:2] and ends[0] != ends[1]

    @pytest.mark.parametrize("world", [0, 1])
    def test_worlds_that_have_ended_send_and_do_nothing(self, loaded, world):
        end = loaded.result["finished_at"][world]
        robots = of_world(loaded.robots, world)
        after_end = robots.filter(pc.field("step") > end)
        assert after_end["turn"].null_count == after_end.num_rows
        assert after_end["message"].null_count == after_end.num_rows

        at_end = robots.filter((pc.field("step") == end) & pc.field("is_alive"))
        assert at_end.num_rows > 0
        assert at_end["turn"].null_count == at_end["message"].null_count == 0

        is_running = of_world(loaded.steps, world)["is_running"].to_pylist()
        assert is_running == [step <= end for step in range(len(is_running))]


class TestFolders:
    def test_each_recorded_world_has_its_own(self, small_run):
        names = {path.name for path in small_run.iterdir()}
        assert names == {RECORDING, RESULT, TRAJECTORY, "world-0"}

    def test_measures_are_those_of_all_worlds(self, small_run):
        content = json.loads((small_run / RESULT).read_text())
        assert content["n_worlds"] == 3
        for name in ("delivered", "picked", "collisions", "finished_at", "fitness"):
            assert len(content[name]) == 3
        assert len(content["mean_carriage_steps"]) == 3

    @pytest.mark.parametrize(("folder", "world"), [(".", 1), ("world-0", 0)])
    def test_files_of_a_world_agree_with_the_result(self, small_run, folder, world):
        content = json.loads((small_run / RESULT).read_text())
        with np.load(small_run / folder / TRAJECTORY) as file:
            assert file["scene_world"] == world
            assert file["collisions"][-1] == content["collisions"][world]
        recorded = read(small_run / folder / RECORDING)["/__properties/result"]
        assert recorded["steps"] == [content["finished_at"][world]]
        for name in ("collisions", "picked", "delivered"):
            assert recorded[name] == [content[name][world]]


def test_a_run_is_loaded_from_its_result(small_run):
    by_directory = iswarm_mj.load(small_run)
    by_result = iswarm_mj.load(str(small_run / RESULT))
    assert by_result.robots.equals(by_directory.robots)
    assert by_result.result == by_directory.result


@pytest.mark.parametrize(("folder", "world"), [(".", 1), ("world-0", 0)])
def test_a_world_is_loaded_from_its_trajectory(small_run, folder, world):
    run = iswarm_mj.load(small_run)
    alone = iswarm_mj.load(small_run / folder / TRAJECTORY)
    assert list(alone.scenes) == [world]
    assert alone.result == run.result
    assert alone.links.equals(of_world(run.links, world))


@pytest.fixture
def copy(small_run, tmp_path):
    """Function that copies the run without some files, and with other arrays in the trajectory.

    Arrays are replaced by values, or by functions of the old values; None removes them.
    """

    def make(*left_out, **changes):
        for file in small_run.glob("*.*"):
            if file.name not in left_out:
                (tmp_path / file.name).write_bytes(file.read_bytes())
        if changes:
            with np.load(small_run / TRAJECTORY) as file:
                arrays = dict(file)
            for name, change in changes.items():
                arrays[name] = change(arrays[name]) if callable(change) else change
            kept = {name: values for name, values in arrays.items() if values is not None}
            np.savez(tmp_path / TRAJECTORY, **kept)
        return tmp_path

    return make


class TestWithoutAResult:
    def test_the_trajectory_of_an_interrupted_run_describes_it(self, small_run, copy):
        """But it has no measures."""
        run = iswarm_mj.load(small_run)
        interrupted = iswarm_mj.load(copy(RESULT))
        assert interrupted.config == run.config and interrupted.genome == run.genome
        assert interrupted.result.items() < run.result.items()
        assert interrupted.robots.equals(of_world(run.robots, 1))

    def test_a_result_of_another_run_above_is_not_that_of_the_trajectory(self, copy):
        directory = copy()
        (directory / "part").mkdir()
        (directory / TRAJECTORY).rename(directory / "part" / TRAJECTORY)
        part = iswarm_mj.load(directory / "part")
        assert part.result.items() < iswarm_mj.load(directory).result.items()


def test_a_trajectory_that_needs_more_memory_than_there_is(copy, monkeypatch):
    monkeypatch.setattr("iswarm_mj.utils.ram.available_memory", lambda: 1000)
    with pytest.raises(UserError, match=r"it needs .* of memory"):
        iswarm_mj.load(copy())


DO_NOT_FIT = "the recorded arrays do not fit each other"
REMEDY = "give the --out of a run"
WRONG_ARRAYS = [
    ({"pose": None}, r"is not the trajectory\.npz of a run, for it has no array `pose`"),
    ({"dust_hop": np.zeros((1, 3))}, "`dust_hop` is not there for each"),
    ({"step": np.array([{}])}, "is cut off or no file of arrays"),
    ({"step": lambda step: 2 * step}, "no steps that count from 0"),
    ({"pose": lambda pose: np.nan * pose}, "finite numbers"),
    ({"pose": lambda pose: pose[:, 1:]}, r"`\w+` \(\w+ \(.*\)\) does not fit"),
    ({"scene_ball_radius": lambda radius: 0 * radius}, "finite numbers above 0"),
    ({ABOUT: np.bytes_(b"[1]")}, REMEDY),
    ({ABOUT: np.bytes_(b"\xff")}, REMEDY),
    ({"scene_payload": np.array("[" * 9999)}, DO_NOT_FIT),
    ({"scene_memory_units": lambda units: units[:-1]}, DO_NOT_FIT),
]


def test_a_trajectory_of_another_version_that_lacks_an_array(copy):
    def by_an_older_version(about):
        return np.bytes_(json.dumps({**json.loads(about.item()), "version": "0.1.0"}))

    directory = copy(RESULT, **{ABOUT: by_an_older_version, "scene_team_sizes": None})
    says = r"has no array `scene_team_sizes`, for version 0\.1\.0 wrote it and this is .*read it"
    with pytest.raises(UserError, match=says):
        iswarm_mj.load(directory)


@pytest.mark.parametrize(("changes", "message"), WRONG_ARRAYS)
def test_arrays_that_no_run_has(copy, changes, message):
    directory = copy(RESULT, **changes)
    with pytest.raises(UserError, match=rf"^[^\n]*({message})[^\n]*$"):
        run = iswarm_mj.load(directory)
        assert run.robots and run.links and run.balls


@pytest.mark.parametrize(
    ("group", "name", "value"), [("arena", "colour", 3), ("optics", "mode", "radio")]
)
def test_settings_that_no_run_has(copy, group, name, value):
    directory = copy()
    content = json.loads((directory / RESULT).read_text())
    content["config"][group][name] = value
    (directory / RESULT).write_text(json.dumps(content))
    with pytest.raises(UserError, match=rf"trajectory\.npz.*{name}"):
        iswarm_mj.load(directory)


def test_two_trajectories_of_one_world(copy):
    directory = copy()
    (directory / "world-4").mkdir()
    (directory / "world-4" / TRAJECTORY).write_bytes((directory / TRAJECTORY).read_bytes())
    with pytest.raises(UserError, match=r"two trajectories are of world 1; read .* alone"):
        iswarm_mj.load(directory)


def test_a_run_without_a_trajectory(tmp_path):
    (write_run(tmp_path) / TRAJECTORY).unlink()
    message = r"without trajectory\.npz, .*; wait for the end, or repeat the run"
    with pytest.raises(UserError, match=message):
        load_recorded(tmp_path)


@pytest.mark.parametrize(
    "config",
    [*INTERPRETATIONS.values(), SwarmConfig(optics=OpticsConfig(mode="power", baud_rate=5000.0))],
)
def test_configurations_come_back(config):
    from_json = restored(SwarmConfig, json.loads(json.dumps(asdict(config))))
    assert from_json.optics == config.optics
    assert restored(SwarmConfig, asdict(config)) == config
