"""Loading the files of one run: units, files that lack something, what is no run."""

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

MADE = []


class Attempts(list):
    """In place of a view of attempts, what it is told of each step; `MADE` has those of each recorded world."""

    def __init__(self, *_):
        MADE.append(self)

    def append(self, *told):
        super().append(told)


@pytest.fixture(scope="module")
def small_run(small, tmp_path_factory):
    """Directory of a run of 30 robots, a fifth of them dead, that ends before a second recorded world."""
    out = tmp_path_factory.mktemp("small")
    run = run_of(small, worlds=3, steps=60, seed=6, goal=1, failed_fraction=0.2, record_worlds=(1, 0))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("iswarm_mj.output.rerun_attempts.AttemptView", Attempts)
        run_swarm(run, out, grasps=9)
    return out


def test_attempts_are_told_with_their_steps(small_run):
    for told, place in zip(MADE, (small_run, small_run / "world-0"), strict=True):
        with np.load(place / TRAJECTORY) as file:
            states, positions = file["ball_state"], 1e3 * file["ball_position"]
        assert [step for step, *_ in told] == list(range(1, len(states)))
        for step, attempts, balls in told:
            before, now = states[step - 1], states[step]
            for is_lift, changed in ((True, (before == 0) & (now == 1)), (False, (before == 1) & (now == 2))):
                done = [tried.ball for tried in attempts if tried.is_lift == is_lift and tried.succeeded]
                assert done == np.flatnonzero(changed).tolist()
            np.testing.assert_allclose(balls[now != 1], positions[step, now != 1, :2], atol=1e-4)
        assert sum(len(attempts) for _, attempts, _ in told) > 3


def test_the_dead_and_worlds_that_have_ended_say_and_do_nothing(small_run):
    saved = iswarm_mj.load(small_run)
    assert saved.settings.failed_fraction == 0.2
    robots, ended = saved.robots, {w: saved.result["finished_at"][w] for w in (0, 1)}
    assert None not in ended.values() and ended[0] != ended[1]
    dead = robots.filter(~pc.field("is_alive"))
    assert dead.num_rows == robots.num_rows // 5 and dead["message"].null_count == dead.num_rows
    assert set(dead["forward"].drop_null().to_pylist()) == {0.0}
    for world, last in ended.items():
        after = robots.filter((pc.field("world") == world) & (pc.field("step") > last))
        assert after["turn"].null_count == after["message"].null_count == after.num_rows
        during = robots.filter((pc.field("world") == world) & (pc.field("step") == last) & pc.field("is_alive"))
        assert during["turn"].null_count == during["message"].null_count == 0 < during.num_rows
        running = saved.steps.filter(pc.field("world") == world)["is_running"].to_pylist()
        assert running == [step <= last for step in range(len(running))]


def test_each_recorded_world_has_its_own_folder(small_run):
    content = json.loads((small_run / RESULT).read_text())
    assert {path.name for path in small_run.iterdir()} == {RECORDING, RESULT, TRAJECTORY, "world-0"}
    for name in ("delivered", "picked", "collisions", "mean_carriage_steps", "finished_at", "fitness"):
        assert len(content[name]) == content["n_worlds"] == 3
    for place, world in ((small_run, 1), (small_run / "world-0", 0)):
        with np.load(place / TRAJECTORY) as file:
            assert file["scene_world"] == world and file["collisions"][-1] == content["collisions"][world]
        kept = {"steps": content["finished_at"][world], "collisions": content["collisions"][world]}
        kept |= {name: content[name][world] for name in ("picked", "delivered")}
        found = read(place / RECORDING)["/__properties/result"]
        assert {name: found[name] for name in kept} == {name: [value] for name, value in kept.items()}


def test_any_file_of_a_run_will_do(small_run):
    whole, by_result = iswarm_mj.load(small_run), iswarm_mj.load(str(small_run / RESULT))
    assert by_result.robots.equals(whole.robots) and by_result.result == whole.result
    for file, world in ((small_run / TRAJECTORY, 1), (small_run / "world-0" / TRAJECTORY, 0)):
        alone = iswarm_mj.load(file)
        assert list(alone.scenes) == [world] and alone.result == whole.result
        assert alone.links.equals(of_world(whole.links, world))


@pytest.fixture
def copy(small_run, tmp_path):
    """Function that copies the run without some of its files, and with other arrays in the trajectory."""

    def make(*without, **arrays):
        for file in small_run.glob("*.*"):
            if file.name not in without:
                (tmp_path / file.name).write_bytes(file.read_bytes())
        if arrays:
            with np.load(small_run / TRAJECTORY) as file:
                own = {name: arrays[name](file[name]) if callable(arrays[name]) else arrays[name] for name in arrays}
                values = dict(file) | own
            np.savez(tmp_path / TRAJECTORY, **{name: value for name, value in values.items() if value is not None})
        return tmp_path

    return make


def test_a_run_that_was_interrupted(small_run, copy):
    """Its trajectory says what it was, without measures."""
    whole, saved = iswarm_mj.load(small_run), iswarm_mj.load(copy(RESULT))
    assert saved.config == whole.config and saved.genome == whole.genome
    assert saved.result.items() < whole.result.items()
    assert saved.robots.equals(of_world(whole.robots, 1))


def test_a_result_of_another_run_above_is_not_that_of_the_trajectory(copy):
    place = copy()
    (place / "part").mkdir()
    (place / TRAJECTORY).rename(place / "part" / TRAJECTORY)
    assert iswarm_mj.load(place / "part").result.items() < iswarm_mj.load(place).result.items()


def test_a_trajectory_that_needs_more_memory_than_there_is(copy, monkeypatch):
    monkeypatch.setattr("iswarm_mj.utils.ram.available_memory", lambda: 1000)
    with pytest.raises(UserError, match=r"it needs .* of memory"):
        iswarm_mj.load(copy())


WRONG = [
    ({"pose": None}, r"is not the trajectory\.npz of a run, for it has no array `pose`"),
    ({"dust_hop": np.zeros((1, 3))}, "`dust_hop` is not there for each"),
    ({"step": np.array([{}])}, "is cut off or no file of arrays"),
    ({"step": lambda a: 2 * a}, "no steps that count from 0"),
    ({"pose": lambda a: np.nan * a}, "finite numbers"),
    ({"pose": lambda a: a[:, 1:]}, r"`\w+` \(\w+ \(.*\)\) does not fit"),
    ({"scene_ball_radius": lambda a: 0 * a}, "finite numbers above 0"),
    *(({ABOUT: np.bytes_(text)}, "give the --out of a run") for text in (b"[1]", b"\xff")),
    ({"scene_payload": np.array("[" * 9999)}, "the recorded arrays do not fit each other"),
    ({"scene_memory_units": lambda a: a[:-1]}, "the recorded arrays do not fit each other"),
]


@pytest.mark.parametrize(("changed", "says"), WRONG)
def test_arrays_that_no_run_has(copy, changed, says):
    place = copy(RESULT, **changed)
    with pytest.raises(UserError, match=rf"^[^\n]*({says})[^\n]*$"):
        run = iswarm_mj.load(place)
        assert run.robots and run.links and run.balls


def test_files_that_are_no_run(copy):
    place = copy()
    content = json.loads((place / RESULT).read_text())
    for group, name, value in (("arena", "colour", 3), ("optics", "mode", "radio")):
        changed = content | {"config": content["config"] | {group: content["config"][group] | {name: value}}}
        (place / RESULT).write_text(json.dumps(changed))
        with pytest.raises(UserError, match=rf"trajectory\.npz.*{name}"):
            iswarm_mj.load(place)
    (place / "world-4").mkdir()
    (place / "world-4" / TRAJECTORY).write_bytes((place / TRAJECTORY).read_bytes())
    with pytest.raises(UserError, match=r"two trajectories are of world 1; read .* alone"):
        iswarm_mj.load(place)


def test_a_run_without_a_trajectory(tmp_path):
    (write_run(tmp_path) / TRAJECTORY).unlink()
    with pytest.raises(UserError, match=r"without trajectory\.npz, .*; wait for the end, or repeat the run"):
        load_recorded(tmp_path)


@pytest.mark.parametrize(
    "config", [*INTERPRETATIONS.values(), SwarmConfig(optics=OpticsConfig(mode="power", baud_rate=5000.0))]
)
def test_configurations_come_back(config):
    assert restored(SwarmConfig, json.loads(json.dumps(asdict(config)))).optics == config.optics
    assert restored(SwarmConfig, asdict(config)) == config
