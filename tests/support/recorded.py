"""Files of a small recorded run, made by hand; and rows of one world in tables."""

import json
from dataclasses import asdict

import numpy as np
import pyarrow.compute as pc

from iswarm_mj.config.swarm import SwarmConfig
from iswarm_mj.output.message_columns import payload_json
from iswarm_mj.output.schema import ARRAYS, dtype_of
from iswarm_mj.output.trajectory import RESULT, SCENE, TRAJECTORY, Scene
from iswarm_mj.sensors.messages import Payload
from iswarm_mj.strategy.genome import Genome


def scene(n_robots=4, n_balls=2):
    """Return the constants of a world whose robots say and remember nothing."""
    return Scene(
        robot_size=np.array([[2e-3, 2e-3, 1e-3]] * n_robots),
        is_scout=np.zeros(n_robots, bool),
        ball_radius=np.full(n_balls, 2e-5),
        arena_size=0.139,
        dump=np.array([-0.01, -0.01, 0.01, 0.01]),
        dust_areas=np.array([[-0.05, -0.01, -0.03, 0.01]]),
        control_period=1.0,
        is_alive=np.ones(n_robots, bool),
        payload=payload_json(Payload()),
        world=0,
        n_leds=4,
        kind=np.zeros(n_robots, int),
    )


def zeros(**sizes):
    """Return arrays of frames that are all zero, by the sizes of their axes."""
    arrays = {}
    for name, field in ARRAYS.items():
        axes = field.type.dim_str.split()
        shape = [sizes[axis] if axis in sizes else int(axis) for axis in axes]
        arrays[name] = np.zeros(shape, dtype_of(name))
    return arrays


def arrays(n_steps=3, n_robots=4, n_balls=2):
    """Return arrays of a trajectory: robots anywhere, balls on the floor, and nobody hears."""
    rng = np.random.default_rng(1)
    frames = zeros(T=n_steps, N=n_robots, K=n_balls, M=0, S=4)
    frames |= {
        "step": np.arange(n_steps, dtype=np.int32),
        "is_running": np.ones(n_steps, bool),
        "is_alive": np.ones((n_steps, n_robots), bool),
        "pose": rng.uniform(-0.02, 0.02, (n_steps, n_robots, 3)).astype(np.float32),
        "ball_position": np.full((n_steps, n_balls, 3), 2e-5, np.float32),
    }
    constants = scene(n_robots, n_balls)._asdict()
    return frames | {SCENE + name: np.asarray(value) for name, value in constants.items()}


SIZES = {"n_robots": "scene_is_scout", "n_balls": "scene_ball_radius", "n_steps": "step"}
"""Arrays whose lengths are sizes of a trajectory."""


def write_run(out, config=None, **changed):
    """Write result.json and trajectory.npz, and return their directory.

    Args:
        out: directory.
        config: configuration of the run, by default that of the paper.
        changed: arrays that replace those of `arrays`, whose sizes follow from them.
    """
    result = {
        "version": "",
        "config": asdict(config or SwarmConfig()),
        "genome": asdict(Genome()),
        "task": {},
        "settings": {"n_robots": 4, "steps": 2},
        "robot": {"file": None},
        "wall_s": 1.0,
    }
    (out / RESULT).write_text(json.dumps(result))

    sizes = {size: len(changed[name]) for size, name in SIZES.items() if name in changed}
    np.savez(out / TRAJECTORY, **{**arrays(**sizes), **changed})
    return out


def of_world(table, world):
    """Return the rows of a world in a table of Arrow."""
    return table.filter(pc.field("world") == world)
