"""A made-up run of a swarm, and its recording."""

from contextlib import closing

import numpy as np

from iswarm_mj.output.message_columns import payload_json
from iswarm_mj.output.rerun_swarm import Recording
from iswarm_mj.output.schema import Frames, dtype_of
from iswarm_mj.output.swarm_classes import possible_states
from iswarm_mj.strategy.vector_strategy import payload_for
from support.recorded import scene, zeros

PERIOD = 0.4
"""Duration of a control step [s]."""


def names(scene):
    """Return the names of the states of a scene's robots."""
    return [state.name for state in possible_states(scene)]


def make_scene(n_robots=40, n_balls=12):
    """Return a scene in which every second robot is of another kind, which is larger."""
    rng = np.random.default_rng(1)
    size_of_kind = np.array([[2e-3, 2e-3, 1e-3], [2.4e-3, 1.6e-3, 1e-3]])
    return scene(n_robots, n_balls)._replace(
        robot_size=size_of_kind[np.arange(n_robots) % 2],
        is_scout=rng.random(n_robots) < 0.15,
        arena_size=98e-3,
        dump=np.array([-7e-3, -7e-3, 7e-3, 7e-3]),
        dust_areas=np.array([[-45e-3, 20e-3, -20e-3, 45e-3], [22e-3, -45e-3, 45e-3, -22e-3]]),
        control_period=PERIOD,
        payload=payload_json(payload_for(140.0)),
        memory_names=(
            "dust_vector",
            "dust_known",
            "dump_vector",
            "dump_known",
            "dust_hop",
            "dump_hop",
        ),
        memory_units=("m", "", "m", "", "", ""),
        memory_sizes=(2, 1, 2, 1, 1, 1),
        boxes=np.array([[2e-3, 1e-3, 1e-5, 0.01]]),
    )


def make_frames(scene, n_frames=50, seed=0):
    """Return frames of random walks.

    Robots carry a ball now and then, hear each other, and learn and forget where dust and dump are.
    """
    rng = np.random.default_rng(seed)
    n_robots = len(scene.is_scout)
    n_balls = len(scene.ball_radius)
    n_boxes = len(scene.boxes)
    robots = np.arange(n_robots)
    steps = np.arange(n_frames)[:, None]

    # Robots walk at random, and stop at the walls.
    turns = rng.uniform(-np.pi, np.pi, n_robots)
    yaw = turns + np.cumsum(rng.normal(0, 0.35, (n_frames, n_robots)), axis=0)
    path = np.cumsum(0.4e-3 * np.stack([np.cos(yaw), np.sin(yaw)], axis=-1), axis=0)
    half = scene.arena_size / 2 - 2e-3
    xy = np.clip(rng.uniform(-half, half, (n_robots, 2)) + path, -half, half)

    # Each ball has its holder, who carries it some of the time.
    holder = np.arange(n_balls) % n_robots
    is_held = (steps + 7 * np.arange(n_balls)) % 40 > 25
    is_loaded = np.zeros((n_frames, n_robots), bool)
    is_loaded[:, holder] = is_held
    ball_xy = np.where(is_held[..., None], xy[:, holder], 5e-3)
    ball_height = np.full((n_frames, n_balls, 1), 20e-6)

    is_heard = rng.random((n_frames, n_robots, 4)) < 0.1
    values = {
        "step": steps[:, 0],
        "pose": np.concatenate([xy, yaw[..., None]], axis=-1),
        "is_running": np.ones(n_frames, bool),
        "message": rng.integers(2**32, size=(n_frames, n_robots), dtype=np.uint32),
        "command": rng.normal(0, [0.5, 1e-3], (n_frames, n_robots, 2)),
        "is_alive": np.ones((n_frames, n_robots), bool),
        "is_loaded": is_loaded,
        "has_priority": is_loaded & (robots % 3 > 0),
        "ball_position": np.concatenate([ball_xy, ball_height], axis=-1),
        "ball_state": is_held,
        "ball_holder": np.tile(holder, (n_frames, 1)),
        "box_pose": np.cumsum(rng.normal(0, [2e-4, 3e-4, 0.1], (n_frames, n_boxes, 3)), axis=0),
        "link_sender": np.where(is_heard, rng.integers(n_robots, size=is_heard.shape), -1),
        "link_valid": is_heard,
        "link_led": rng.integers(4, size=is_heard.shape),
        "link_heard": is_heard & (rng.random(is_heard.shape) < 0.8),
        "picked": np.cumsum(rng.integers(2, size=n_frames)),
        "delivered": steps[:, 0] // 3,
        "collisions": np.cumsum(rng.integers(3, size=n_frames)),
        "mean_speed": rng.uniform(0.8e-3, 1e-3, n_frames),
    }

    # Memories that come and go; vectors of unknown places are undefined.
    memory = {
        "dust_known": (steps + 11 * robots) % 30 > 12,
        "dump_known": (steps + 11 * robots + 5) % 30 > 12,
    }
    for place in ("dust", "dump"):
        vector = rng.normal(0, 0.02, (n_frames, n_robots, 2))
        vector = np.where(memory[f"{place}_known"][..., None], vector, np.nan)
        memory[f"{place}_vector"] = vector.astype(np.float32)
        memory[f"{place}_hop"] = rng.integers(15, size=(n_frames, n_robots))

    arrays = zeros(T=n_frames, N=n_robots, K=n_balls, S=4, M=n_boxes) | values
    arrays = {name: array.astype(dtype_of(name)) for name, array in arrays.items()}
    return Frames(**arrays, memory=memory)


def joined(blocks):
    """Return blocks of frames as one."""
    arrays_of_blocks = [block.arrays() for block in blocks]
    names_of_arrays = list(arrays_of_blocks[0])
    return Frames.from_arrays(
        {name: np.concatenate([a[name] for a in arrays_of_blocks]) for name in names_of_arrays}
    )


def cut(frames, start, stop):
    """Return the frames of some steps."""
    return frames[start:stop]


def write(path, scene, frames, cuts=(1, 6, 23), config=None):
    """Write a recording, in blocks that end at `cuts`."""
    with closing(Recording(path, scene, config or {}, {})) as recording:
        for start, stop in zip((0, *cuts), (*cuts, len(frames)), strict=True):
            recording.append(cut(frames, start, stop))


def column(recorded, entity, name):
    """Return a column of a recording that was read back, as arrays."""
    return [np.array(row) for row in recorded[entity][name]]
