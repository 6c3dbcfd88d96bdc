"""A small recorded run, made by hand; what was recorded of one world."""

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
    """Constants of a world whose robots say and remember nothing."""
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
    """Arrays of frames without anything, by the sizes of their axes."""
    shapes = {
        name: [sizes[axis] if axis in sizes else int(axis) for axis in f.type.dim_str.split()]
        for name, f in ARRAYS.items()
    }
    return {name: np.zeros(shape, dtype_of(name)) for name, shape in shapes.items()}


def arrays(n_steps=3, n_robots=4, n_balls=2):
    """Arrays of a trajectory: robots anywhere, balls that lie, nobody who hears anything."""
    rng, made = np.random.default_rng(1), zeros(T=n_steps, N=n_robots, K=n_balls, M=0, S=4)
    made |= {
        "step": np.arange(n_steps, dtype=np.int32),
        "is_running": np.ones(n_steps, bool),
        "is_alive": np.ones((n_steps, n_robots), bool),
        "pose": rng.uniform(-0.02, 0.02, (n_steps, n_robots, 3)).astype(np.float32),
        "ball_position": np.full((n_steps, n_balls, 3), 2e-5, np.float32),
    }
    return made | {
        SCENE + name: np.asarray(value)
        for name, value in scene(n_robots, n_balls)._asdict().items()
    }


def write_run(out, config=None, **changed):
    """Write result.json and trajectory.npz; `changed` arrays replace those of `arrays`, which have
    their sizes."""
    sizes = {"n_robots": changed["scene_is_scout"].shape[0]} if "scene_is_scout" in changed else {}
    sizes |= (
        {"n_balls": changed["scene_ball_radius"].shape[0]} if "scene_ball_radius" in changed else {}
    )
    sizes |= {"n_steps": len(changed["step"])} if "step" in changed else {}
    about = {
        "version": "",
        "config": asdict(config or SwarmConfig()),
        "genome": asdict(Genome()),
        "task": {},
    }
    about |= {"settings": {"n_robots": 4, "steps": 2}, "robot": {"file": None}, "wall_s": 1.0}
    (out / RESULT).write_text(json.dumps(about))
    np.savez(out / TRAJECTORY, **{**arrays(**sizes), **changed})
    return out


def of_world(table, world):
    """Rows of a table of Arrow."""
    return table.filter(pc.field("world") == world)
