"""States of robots: what they do, carry and know, in that order."""

from dataclasses import replace

import numpy as np
from support.swarm_recording import make_frames, make_scene, names

from iswarm_mj.output.palette import EMPTY, LOADED, rgb
from iswarm_mj.output.swarm_classes import robot_classes, shown_classes, states_of


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


def test_loaded_robots_of_teams_are_darker():
    scene, _ = of_robots(team_names=("home", "guests"), team_sizes=(2, 4))
    is_loaded = np.array([[False, True, False, True, True, False]])
    assert robot_classes(scene, is_loaded, ~is_loaded).tolist() == [[30, 31, 32, 33, 33, 32]]
    shown = shown_classes(scene)
    assert [(place, label) for place, label, _ in shown] == [
        *((30, "home"), (31, "home, loaded")),
        *((32, "guests"), (33, "guests, loaded")),
    ]
    colours = np.array([colour for *_, colour in shown])
    assert colours[[0, 2]].tolist() == [list(rgb(EMPTY)), list(rgb(LOADED))]
    assert (colours[[1, 3]] == colours[[0, 2]] * 3 // 5).all()
    assert shown_classes(scene._replace(ball_radius=np.zeros(0))) == shown[::2]
