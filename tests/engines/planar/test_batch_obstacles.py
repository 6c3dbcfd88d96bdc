"""Obstacles in the planar engine for batches: contacts and light as in the engine for CPUs. Units: mm, s."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from helpers_obstacles import BOXES, CONFIG, N, starts
from helpers_planar import both_engines, moved, placed, rounded
from helpers_touching import pairs_of

from iswarm_mj.config import OpticsConfig
from iswarm_mj.engines.planar.gpu.physics import rooms
from iswarm_mj.simulation.step import drive_phases
from iswarm_mj.strategy.interface import Command
from iswarm_mj.utils.errors import FaultKind
from iswarm_mj.utils.obstacles import distances, numbers
from iswarm_mj.utils.units import RD

SOLID = numbers(BOXES, RD)
RUNNING = np.ones(3, bool)


@cache
def engines(refinement=1, mode="sector", boxes=BOXES):
    arena = replace(CONFIG.arena, obstacles=boxes)
    return both_engines(replace(CONFIG, arena=arena, optics=OpticsConfig(mode=mode)), refinement)


@pytest.mark.parametrize(("refinement", "n_steps", "share"), [(1, 8, 1.0), (10, 4, 0.98)])
def test_steps_end_where_those_of_the_other_engine_end(refinement, n_steps, share):
    """Within 0.001 mm after each control step of a crowd, begun at the same places, and the same pairs touch.

    With fine steps rounding decides at some robots in which of them a contact begins, with obstacles or without.
    """
    rng, poses, n_touched, off = np.random.default_rng(1), rounded(starts(1)), 0, []
    for _ in range(n_steps):
        command = Command(*map(rounded, (rng.uniform(-0.3, 0.3, (3, N)), np.full((3, N), 1.4))))
        phases = drive_phases(CONFIG.drive, command)
        plain, batch = (engine.move(placed(engine, poses), phases, RUNNING) for engine in engines(refinement))
        assert not plain.fault.any() and not np.any(batch.fault)
        off.append(np.abs(batch.bodies.poses - plain.bodies.poses)[..., :2].max(axis=-1))
        assert np.not_equal(pairs_of(batch.touching), pairs_of(plain.touching)).sum() <= 3 * (1.0 - share) * N
        poses = rounded(plain.bodies.poses)
        away = distances(poses[..., :2].reshape(-1, 2), SOLID)
        n_touched += (away < 1.2).sum()
        assert away.min() > 0.8  # half a robot is 1 mm
    assert np.mean(np.array(off) < 1e-3) >= share and np.max(off) < 0.02
    assert n_touched > 5 and pairs_of(plain.touching).sum() > 5


def test_a_robot_between_two_boxes_and_a_wall():
    """Pressed into a corner that a box makes with the wall, and into one of two boxes, it stays out of all three."""
    boxes = ((6.4, 0.0, 1.1, 1.0, 0.0), (-4.0, 0.0, 1.0, 1.0, 0.0), (-2.5, 1.5, 0.5, 0.5, 0.0))
    start = np.array([[(19.5, 4.5, 0.2), (-10.0, 4.5, 0.1), (0.0, -6.0, 0.0)]])
    present = np.array([[True, True, False]])
    found = []
    for engine in engines(boxes=boxes):
        bodies = placed(engine, start, present)
        for _ in range(3):
            motion = moved(engine, bodies, [(1.0, -1.0, 0.3), (1.0, -1.0, 0.3), (0.0, 5.0, 0.0)], 20)
            bodies = motion.bodies
        assert not np.any(motion.fault)
        found.append(np.asarray(motion.bodies.poses))
    np.testing.assert_allclose(found[1], found[0], atol=1e-3)
    np.testing.assert_allclose(found[1][0, :2, :2], [(7.5 * RD - 1, RD + 1), (-3 * RD - 1, RD + 1)], atol=0.1)
    np.testing.assert_array_equal(found[1][0, 2], start[0, 2])


@pytest.mark.parametrize("mode", ["sector", "power"])
def test_links_and_walls_are_those_of_the_other_engine(mode):
    """With absent robots and dark ones; obstacles hide some senders, and are seen."""
    free = engines(mode=mode, boxes=())[1]
    n_hidden = n_seen = 0
    for seed in range(6):
        rng = np.random.default_rng(seed)
        poses = rounded(starts(10 + seed) + rng.uniform(-0.05, 0.05, (3, N, 3)))
        emits, present = rng.random((2, 3, N)) < 0.9
        plain, batch, unhindered = (
            e.sense(placed(e, poses, present), emits, RUNNING) for e in (*engines(mode=mode), free)
        )
        for name in ("sender", "valid", "led"):
            np.testing.assert_array_equal(getattr(batch.links, name), getattr(plain.links, name))
        np.testing.assert_array_equal(batch.sees_wall, plain.sees_wall)
        n_hidden += (np.asarray(unhindered.links.valid) & ~plain.links.valid).sum()
        n_seen += (plain.sees_wall & ~np.asarray(unhindered.sees_wall)).sum()
    assert n_hidden > 20 and n_seen > 20


def test_a_led_inside_an_obstacle_sees_it():
    """As of a robot pressed into it; one whose axis a third robot crosses first sees none."""
    boxes = ((9 / RD, 0.0, 2 / RD, 2 / RD, 0.0),)  # from 7 mm on
    beside, between = (0.0, 6.0, 0.0), (4.6, 0.0, 0.0)
    poses = np.array([[(6.2, 0.0, 0.0), beside], [(2.0, 0.0, 0.0), between], [(2.0, 0.0, 0.0), beside]])
    for engine in engines(boxes=boxes):
        sees = np.asarray(engine.sense(placed(engine, poses), np.ones((3, 2), bool), RUNNING).sees_wall)
        assert sees[:, 0, 0].tolist() == [True, False, True]


def test_room_for_contacts_with_obstacles():
    """As many as four a robot; heaps of more obstacles on one place are a fault of their world alone."""
    assert rooms(40, 0, 4, 0, 1)[1] + 40 == rooms(40, 0, 4, 1, 1)[1] == rooms(40, 0, 5, 0, 1)[1]
    assert rooms(40, 0, 4, 4, 1) == rooms(40, 0, 4, 9, 1)
    boxes = tuple((4.0 + 0.01 * k, 4.0, 1.0, 1.0, 0.0) for k in range(30))
    start = np.tile([(9.0, 9.0, 0.1), (9.0, 9.0, 0.2), (-8.0, -8.0, 0.0)], (2, 1, 1))
    start[0, :2] = [(-8.0, 8.0, 0.0), (8.0, -8.0, 0.0)]
    batch = engines(boxes=boxes)[1]
    motion = moved(batch, placed(batch, start), 0.1, 2)
    assert motion.fault[0] == 0 and motion.fault[1] & FaultKind.TOO_MANY_CONTACTS
