"""A user's task that derives from `Cleaning` and has a state of its own, through the commands.

A door, a box of mass 0, slides into a gap step by step; a disc on the floor grows with the share of
the way that it has come. Units: mm, unless a comment says otherwise.
"""

import re
import shlex

import numpy as np
import pytest
from support.cli import code_of, result
from support.rrd import read

import iswarm_mj
from iswarm_mj.commands.main import parse
from iswarm_mj.simulation.scenario import Scenario

TASK = '''
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, NamedTuple

import jax.numpy as jnp
import numpy as np

from iswarm_mj import Cleaning, AreaStyle, Quantity, Within, poses_of_boxes


class ClosingState(NamedTuple):
    balls: Any
    boxes: Any
    way: Any
    """Way that the door has come [mm]."""


@dataclass(frozen=True)
class Closing(Cleaning):
    """Cleaning, while a door closes."""

    slide: Annotated[float, Within(0, 4, "mm")] = 1.0
    """Way of the door in a step [mm]."""
    length: int = 8
    """Whole way of the door [mm]."""

    measured: ClassVar = {
        **Cleaning.measured,
        "closed": Quantity("share of the way that the door has come", high=1.0),
        "way": Quantity("way that the door has come", "mm"),
    }
    drawn: ClassVar = {**Cleaning.drawn, "lock": AreaStyle(colour=(10, 20, 30))}

    def lay_boxes(self, config, rng, shared):
        return [(0.0, 7.0, 0.5, 1.0, 0.0, 0.0, 0.0)]

    def lay_out(self, config, n_robots, rng, shared, cell):
        poses, balls = super().lay_out(config, n_robots, rng, shared, cell)
        boxes = poses_of_boxes(config.arena.boxes).astype(np.float32)
        return poses, ClosingState(balls, boxes, way=np.float32(0))

    def advance(self, state, inputs, key):
        balls, sensed = super().advance(state.balls, inputs, key)
        way = jnp.minimum(state.way + self.slide, self.length).astype(jnp.float32)
        boxes = state.boxes.at[0, 1].add(way - state.way)
        return ClosingState(balls, boxes, way), sensed

    def drive_boxes(self, state):
        return state.boxes

    def balls(self, state):
        return state.balls

    def progress(self, state):
        return super().progress(state.balls)

    def reward(self, before, after, inputs):
        return super().reward(before.balls, after.balls, inputs)

    def metrics(self, state):
        closed = state.way / self.length
        return {**super().metrics(state.balls), "closed": closed, "way": state.way}

    def areas(self, config, state):
        areas = super().areas(config, state.balls)
        disc = jnp.array([[0.0, 0.0, 1.0]]) * (1.0 + state.way)
        return {**areas, "lock": disc}
'''
N = 8
STEPS = 5
SLIDE = 2.0
WAY = np.minimum(SLIDE * np.arange(STEPS + 1), 8)
"""Way of the door after each step."""
NAME = "closing.py:Closing"
FLAGS = (
    *("--arena.size=24", "--arena.n-dust=6", "--arena.dust-area-size=4"),
    *("--arena.dust-area-offset=7", f"--robots={N}", "--engine=planar", "--threads=1"),
)
FILE = f"""
task = "{NAME}"
slide = {SLIDE}
robots = {N}
engine = "planar"
threads = 1

[arena]
size = 24
n-dust = 6
dust-area-size = 4
dust-area-offset = 7
"""
YIELDS = 0.05
"""A driven box is at most so far from where it is to be."""


@pytest.fixture(scope="module")
def directory(tmp_path_factory):
    """A directory with the task, and the results of a run of two worlds in `runs/task`."""
    path = tmp_path_factory.mktemp("closing")
    (path / "closing.py").write_text(TASK)
    (path / "closing.toml").write_text(FILE)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(path)
        worlds = ("--worlds=2", "--record-worlds", "0", "1")
        command = ("run", "--task", NAME, *FLAGS, f"--steps={STEPS}", f"--slide={SLIDE}")
        assert code_of(*command, *worlds) == 0
    return path


@pytest.fixture(autouse=True)
def there(directory, monkeypatch):
    """Work in that directory."""
    monkeypatch.chdir(directory)


def test_the_result_has_its_settings_and_metrics():
    content = result("runs/task")
    assert content["task"] == {"class": "Closing", "slide": SLIDE, "length": 8}
    assert content["metrics"]["way"] == [8.0, 8.0] and content["units"] == {"way": "mm"}
    assert content["metrics"]["closed"] == [1.0, 1.0]
    assert content["metrics"]["picked"] == content["picked"]


@pytest.mark.parametrize("place", ["", "world-1/"])
def test_the_recording_has_its_areas_boxes_balls_and_metrics(place):
    recorded = read(f"runs/task/{place}run.rrd")
    for metric, expected in (("way", WAY), ("closed", WAY / 8)):
        values = recorded[f"/series/task/{metric}"]["Scalars:scalars"]
        np.testing.assert_allclose(np.ravel(values), expected, rtol=1e-6)
    radii = recorded["/world/arena/lock"]["Cylinders3D:radii"]
    np.testing.assert_allclose(np.ravel(radii), 1 + WAY, rtol=1e-6)

    boxes = np.array(recorded["/world/boxes"]["Boxes3D:centers"])
    moved = boxes[:, 0, 1] - boxes[0, 0, 1]
    np.testing.assert_allclose(moved, np.concatenate([[0], WAY[1:]]), atol=YIELDS)
    assert len(recorded["/world/balls/true_size"]["Points3D:positions"][0]) == 6
    assert "/world/arena/dump" in recorded and "/world/arena/dust_areas" in recorded


def test_tables_have_its_metrics_and_boxes():
    run = iswarm_mj.load("runs/task")
    distance = run.steps["way"].to_numpy().reshape(2, STEPS + 1)
    np.testing.assert_allclose(distance, [WAY, WAY], rtol=1e-6)
    assert run.steps.schema.field("way").metadata[b"unit"] == b"mm"
    assert run.boxes.num_rows == 2 * len(WAY) and run.balls.num_rows == 2 * 6 * len(WAY)


def test_inspect_shows_it_and_a_command_that_repeats_it(capfd):
    assert code_of("inspect", "runs/task") == 0
    text = capfd.readouterr().out
    assert text.startswith("run of the task Closing on planar")
    lines = dict(re.findall(r"^ *(\S.*?)  +(.*)$", text, re.M))
    assert lines["task"] == "Closing" and lines["closed"] == "1, 1" and lines["way"] == "8, 8 mm"
    assert lines["run.rrd"].endswith("recording: rerun runs/task/run.rrd")

    repeat = re.search(r"; (iswarm run .*) repeats it", text)[1]
    command = shlex.split(repeat.replace("FILE.py:Closing", NAME).removeprefix("iswarm "))
    assert code_of(*command, "--out=runs/again", "--threads=1") == 0
    again = result("runs/again")
    for name in ("task", "metrics", "config", "settings", "collisions", "picked"):
        assert again[name] == result("runs/task")[name]


class TestPage:
    """`iswarm play --config FILE`, without a browser."""

    @pytest.mark.parametrize(
        "config", [["closing.toml"], ["runs/task/result.json", "--task", NAME, "--worlds=1"]]
    )
    def test_a_file_begins_it(self, config):
        session = parse(["play", "--config", *config, "--threads=1"]).session()
        for _ in range(3):
            session.advance()
        assert list(session.lines["way"]) == [0.0, 2.0, 4.0, 6.0]
        box = session.snapshots[-1].record.boxes[0, 0, 0]
        start = session.snapshots[0].record.boxes[0, 0, 0]
        np.testing.assert_allclose(box[:2] - start[:2], [0.0, 6.0], atol=YIELDS)

    @pytest.mark.slow
    def test_its_settings_change_and_balls_drop(self):
        session = parse(["play", "--config=closing.toml"]).session()
        controls = {control.name: control for control in session.controls()}
        assert controls["slide"].is_live and not controls["length"].is_live
        assert (controls["slide"].high, controls["slide"].unit) == (4.0, "mm")

        session.advance()
        session.set("slide", 0.5)
        session.set("length", 3)
        session.change("ball", "1.5,-2")
        session.advance()
        assert list(session.lines["way"]) == [0.0, 2.0, 2.5] and session.pending == ["length"]
        balls = session.run.task.balls(session.snapshots[-1].record.swarm.task)
        place = iswarm_mj.mm_from_rd(np.array([1.5, -2.0]))
        assert np.linalg.norm(np.asarray(balls.position)[0, 0] - place, axis=-1).min() < 1e-3
        session.reset()
        for _ in range(8):
            session.advance()
        assert session.lines["way"][-1] == 3.0

    def test_what_it_shares_repeats_it(self, directory):
        session = parse(["play", "--config=closing.toml"]).session()
        session.advance()
        session.set("slide", 0.5)
        session.advance()
        (directory / "shared.toml").write_text(session.toml())
        again = parse(["play", "--config=shared.toml", "--threads=1"]).session()
        for _ in range(2):
            again.advance()
        assert list(again.lines["way"]) == list(session.lines["way"]) == [0.0, 2.0, 2.5]
        np.testing.assert_array_equal(
            again.snapshots[-1].record.poses, session.snapshots[-1].record.poses
        )

    def test_it_records(self):
        session = parse(["play", "--config=closing.toml"]).session()
        session.advance()
        session.start_recording()
        for _ in range(2):
            session.advance()
        session.stop_recording()
        values = read(session.recording)["/series/task/way"]["Scalars:scalars"]
        assert np.ravel(values).tolist() == [2.0, 4.0, 6.0]


def test_a_scenario_is_written_and_read(directory):
    scenario = Scenario.from_toml("closing.toml")
    (directory / "written.toml").write_text(scenario.to_toml())
    read_again = Scenario.from_toml("written.toml")
    assert (read_again.task.slide, read_again.task.length, read_again.task_name) == (SLIDE, 8, NAME)
    assert (read_again.config, read_again.n_robots) == (scenario.config, N)
