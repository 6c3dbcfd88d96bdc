"""A small recorded run, made by hand; what was recorded of one world."""

import json
from dataclasses import asdict

import numpy as np
import pyarrow.compute as pc

from iswarm_mj.config import SwarmConfig
from iswarm_mj.output.trajectory import RESULT, TRAJECTORY


def arrays(n_steps=3, n_robots=4, n_balls=2):
    """Arrays of a trajectory, as far as pictures and videos need them."""
    rng = np.random.default_rng(1)
    return {
        "step": np.arange(n_steps),
        "pose": rng.uniform(-0.02, 0.02, (n_steps, n_robots, 3)).astype(np.float32),
        "is_loaded": np.zeros((n_steps, n_robots), bool),
        "ball_position": np.full((n_steps, n_balls, 3), 2e-5, np.float32),
        "delivered": np.zeros(n_steps, np.int32),
        "scene_is_scout": np.zeros(n_robots, bool),
        "scene_ball_radius": np.full(n_balls, 2e-5),
    }


def write_run(out, config=None, **changed):
    """Write result.json and trajectory.npz; `changed` arrays replace those of `arrays`."""
    (out / RESULT).write_text(json.dumps({"config": asdict(config or SwarmConfig())}))
    np.savez(out / TRAJECTORY, **{**arrays(), **changed})
    return out


def of_world(table, world):
    """Rows of a table of Arrow."""
    return table.filter(pc.field("world") == world)
