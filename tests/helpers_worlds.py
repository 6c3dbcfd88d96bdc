"""Beginnings of worlds, and where balls are."""

from iswarm_mj.engines.arena import read_robot
from iswarm_mj.simulation import initial
from iswarm_mj.tasks.cleaning import CLEANING
from iswarm_mj.tasks.grasping import ball_centres


def start_of(config, n_robots, seed, index, failed_fraction=0.0, task=CLEANING):
    """How world `index` of a seed begins, with the paper's robots."""
    return initial.draw_start(config, task, read_robot(), n_robots, seed, index, failed_fraction)


def centres(record):
    """Centres of the balls in the record of a run of cleaning, with the paper's robots [mm]."""
    return ball_centres(record.swarm.task, record.poses, read_robot())
