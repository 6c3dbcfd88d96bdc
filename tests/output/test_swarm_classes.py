"""States of robots: what they do, carry and know, in that order."""

from dataclasses import replace

import numpy as np
from helpers_swarm_recording import make_frames, make_scene, names

from iswarm_mj.output.swarm_classes import states_of


def of_robots(**more):
    """A scene of six robots, and two frames in which their drives walk."""
    scene = make_scene(6, 1)
    walks = np.full((2, 6, 2), 1e-3, np.float32)
    return scene._replace(**more), replace(make_frames(scene, 2), command=walks, is_alive=np.ones((2, 6), bool))


def test_states_by_hand():
    scene, frames = of_robots()
    command, flags = frames.command.copy(), np.zeros((2, 6), bool)
    command[:, 4] = 0
    command[:, 0, 1] = 0  # it turns on the spot
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
