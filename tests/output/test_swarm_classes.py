"""States of robots: what they do, carry and know, in that order; classes of teams."""

from dataclasses import replace

import numpy as np
import pytest
from support.swarm_recording import make_frames, make_scene, names

from iswarm_mj.output.palette import EMPTY, LOADED, rgb
from iswarm_mj.output.swarm_classes import robot_classes, shown_classes, states_of

N_FRAMES = 2
N_ROBOTS = 6


@pytest.fixture
def scene():
    return make_scene(N_ROBOTS, 1)


def flags(*robots):
    """Flags of some robots in all frames."""
    is_set = np.zeros((N_FRAMES, N_ROBOTS), bool)
    is_set[:, list(robots)] = True
    return is_set


def test_states_by_hand(scene):
    """The start and a step, after which robot 5 is dead."""
    command = np.full((N_FRAMES, N_ROBOTS, 2), 1e-3, np.float32)
    command[:, 4] = 0
    command[:, 0, 1] = 0  # it turns on the spot
    is_alive = np.ones((N_FRAMES, N_ROBOTS), bool)
    is_alive[1, 5] = False
    vector = np.ones((N_FRAMES, N_ROBOTS, 2), np.float32)
    frames = make_frames(scene, N_FRAMES)
    frames = replace(
        frames,
        command=command,
        is_alive=is_alive,
        is_loaded=flags(2, 3),
        memory={
            **frames.memory,
            "dust_vector": vector,
            "dust_known": flags(1, 2),
            "dump_vector": vector,
            "dump_known": flags(0, 3),
        },
    )

    places = states_of(scene, frames)

    at_start, after_step = [[names(scene)[place] for place in row] for row in places]
    walking = ["empty", "empty, knows dust", "loaded", "loaded, knows dump"]
    assert after_step == [*walking, "empty, stands", "dead"]
    assert at_start == [*walking, "empty", "empty"]  # nothing was commanded before the start


def test_states_that_cannot_be_are_left_out(scene):
    bare = scene._replace(
        ball_radius=np.zeros(0), memory_names=(), memory_units=(), memory_sizes=()
    )
    assert names(bare) == ["empty", "empty, stands", "dead"]


class TestTeams:
    @pytest.fixture
    def teams(self, scene):
        return scene._replace(team_names=("home", "guests"), team_sizes=(2, 4))

    def test_loaded_robots_have_a_class_of_their_own(self, teams):
        is_loaded = np.array([[False, True, False, True, True, False]])
        classes = robot_classes(teams, is_loaded, ~is_loaded)
        assert classes.tolist() == [[30, 31, 32, 33, 33, 32]]
        assert [(number, label) for number, label, _ in shown_classes(teams)] == [
            (30, "home"),
            (31, "home, loaded"),
            (32, "guests"),
            (33, "guests, loaded"),
        ]

    def test_loaded_robots_are_darker(self, teams):
        colours = np.array([colour for *_, colour in shown_classes(teams)])
        assert colours[[0, 2]].tolist() == [list(rgb(EMPTY)), list(rgb(LOADED))]
        assert (colours[[1, 3]] == colours[[0, 2]] * 3 // 5).all()

    def test_without_balls_no_robot_is_loaded(self, teams):
        without_balls = teams._replace(ball_radius=np.zeros(0))
        assert shown_classes(without_balls) == shown_classes(teams)[::2]
