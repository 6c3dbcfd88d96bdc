"""States of robots in a recording: lanes, counts, and the colours of hop counts."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from helpers_rrd import read
from helpers_swarm_recording import make_frames, make_scene, write

from iswarm_mj.output.rerun_swarm import shown_lanes
from iswarm_mj.output.swarm_classes import states, states_of


def names(scene):
    return [state.name for state in states(scene)]


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A scene, its frames, and what was read back from their recording in uneven blocks."""
    scene, path = make_scene(), tmp_path_factory.mktemp("states") / "run.rrd"
    frames = make_frames(scene)
    write(path, scene, frames)
    return scene, frames, read(path)


def of_robots(**more):
    """A scene of six robots, and two frames in which their drives walk."""
    scene = make_scene(6, 1)
    walks = np.full((2, 6, 2), 1e-3, np.float32)
    return scene._replace(**more), replace(make_frames(scene, 2), command=walks, is_alive=np.ones((2, 6), bool))


def test_states_by_hand():
    scene, frames = of_robots()
    command, flags = frames.command.copy(), np.zeros((2, 6), bool)
    command[:, 4] = 0
    alive = ~flags
    alive[1, 5] = False
    loaded, dust, dump = flags.copy(), flags.copy(), flags.copy()
    loaded[:, [2, 3]] = True
    dust[:, [1, 2]], dump[:, [0, 3]] = True, True
    vectors = dict.fromkeys(("dust_vector", "dump_vector"), np.ones((2, 6, 2), np.float32))
    memory = {**frames.memory, **vectors, "dust_known": dust, "dump_known": dump}
    found = states_of(scene, replace(frames, is_loaded=loaded, command=command, memory=memory, is_alive=alive))
    shown = [[names(scene)[place] for place in row] for row in found]
    wanted = ["empty", "empty, knows dust", "loaded", "loaded, knows dump", "empty, stands", "dead"]
    assert shown[1] == wanted
    assert shown[0] == [*wanted[:4], "empty", "empty"]  # nothing was commanded before the start


def test_states_that_cannot_be_are_left_out():
    scene, _ = of_robots(ball_radius=np.zeros(0), memory_names=(), memory_units=(), memory_sizes=())
    assert names(scene) == ["empty", "empty, stands", "dead"]


def test_lanes_hold_every_change_and_nothing_else(run):
    scene, frames, recorded = run
    found, changes = states_of(scene, frames), 0
    for robot in shown_lanes(scene):
        lane = recorded[f"/states/robot_{robot}"]
        steps, given = np.array(lane["step"]), [state for (state,) in lane["StateChange:state"]]
        assert steps[0] == 0 and all(a != b for a, b in pairwise(given))
        held = [given[np.searchsorted(steps, step, side="right") - 1] for step in frames.step]
        assert held == [names(scene)[place] for place in found[:, robot]]
        changes += len(given) - 1
    assert changes > 0
    assert {entity for entity in recorded if entity.startswith("/states/")} == {
        f"/states/robot_{n}" for n in shown_lanes(scene)
    }


def test_lanes_by_default_are_of_living_robots_from_the_first_to_the_last():
    scene = make_scene(40)._replace(is_alive=np.arange(40) > 9)
    chosen = shown_lanes(scene)
    assert len(chosen) == 8 and (chosen[0], chosen[-1]) == (10, 39)
    assert shown_lanes(make_scene(3)) == (0, 1, 2)
    assert shown_lanes(make_scene(3)._replace(is_alive=np.zeros(3, bool))) == ()


def test_every_robot_is_counted_once(run):
    scene, frames, recorded = run
    counts = np.stack(recorded["/series/states"]["Scalars:scalars"])
    assert counts.shape == (len(frames), len(names(scene)))
    assert (counts.sum(axis=1) == 40).all() and (counts.max(axis=0) > 0).sum() >= 3
    loaded = [place for place, name in enumerate(names(scene)) if name.startswith("loaded")]
    np.testing.assert_array_equal(counts[:, loaded].sum(axis=1), frames.is_loaded.sum(axis=1))


def test_hop_counts_have_colours(run):
    _, frames, recorded = run
    robots = recorded["/world/robots/body"]
    for name in ("dust", "dump"):
        known, hops = frames.memory[f"{name}_known"], frames.memory[f"{name}_hop"]
        colours = np.stack(robots[f"{name}_hop_colour"])
        assert set(colours[~known]) == {0xAAAAAAFF}
        assert set(colours[known & (hops == 0)]) == {0x440154FF}
        assert len(set(colours[known])) == len(set(hops[known])) > 10
