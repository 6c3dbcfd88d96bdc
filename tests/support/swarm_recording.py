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


def names(scene):
    """Of the states of its robots."""
    return [state.name for state in possible_states(scene)]


def make_scene(n_robots=40, n_balls=12):
    """Every second robot is of another kind, as large as one of six sides."""
    rng = np.random.default_rng(1)
    return scene(n_robots, n_balls)._replace(
        robot_size=np.array([[2e-3, 2e-3, 1e-3], [2.4e-3, 1.6e-3, 1e-3]])[np.arange(n_robots) % 2],
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
    """Random walks; robots carry a ball now and then, hear each other, and learn and forget where
    dust and dump are."""
    rng, (n, k) = np.random.default_rng(seed), (len(scene.is_scout), len(scene.ball_radius))
    zero, steps = zeros(T=n_frames, N=n, K=k, S=4, M=len(scene.boxes)), np.arange(n_frames)[:, None]
    yaw = rng.uniform(-np.pi, np.pi, n) + np.cumsum(rng.normal(0, 0.35, (n_frames, n)), axis=0)
    way = np.cumsum(0.4e-3 * np.stack([np.cos(yaw), np.sin(yaw)], axis=-1), axis=0)
    half = scene.arena_size / 2 - 2e-3
    xy = np.clip(rng.uniform(-half, half, (n, 2)) + way, -half, half)
    holder = np.arange(k) % n
    is_held = (steps + 7 * np.arange(k)) % 40 > 25
    is_loaded = np.zeros((n_frames, n), bool)
    is_loaded[:, holder] = is_held
    balls = np.concatenate(
        [np.where(is_held[..., None], xy[:, holder], 5e-3), np.full((n_frames, k, 1), 20e-6)], -1
    )
    valid = rng.random((n_frames, n, 4)) < 0.1
    known = {
        name: (steps + 11 * np.arange(n) + 5 * m) % 30 > 12
        for m, name in enumerate(("dust", "dump"))
    }
    made = {
        "step": steps[:, 0],
        "pose": np.concatenate([xy, yaw[..., None]], axis=-1),
        "is_running": np.ones(n_frames, bool),
        "message": rng.integers(2**32, size=(n_frames, n), dtype=np.uint32),
        "command": rng.normal(0, [0.5, 1e-3], (n_frames, n, 2)),
        "is_alive": np.ones((n_frames, n), bool),
        "is_loaded": is_loaded,
        "has_priority": is_loaded & (np.arange(n) % 3 > 0),
        "ball_position": balls,
        "ball_state": is_held,
        "ball_holder": np.tile(holder, (n_frames, 1)),
        "box_pose": np.cumsum(
            rng.normal(0, [2e-4, 3e-4, 0.1], (n_frames, len(scene.boxes), 3)), axis=0
        ),
        "link_sender": np.where(valid, rng.integers(n, size=valid.shape), -1),
        "link_valid": valid,
        "link_led": rng.integers(4, size=valid.shape),
        "link_heard": valid & (rng.random(valid.shape) < 0.8),
        "picked": np.cumsum(rng.integers(2, size=n_frames)),
        "delivered": steps[:, 0] // 3,
        "collisions": np.cumsum(rng.integers(3, size=n_frames)),
        "mean_speed": rng.uniform(0.8e-3, 1e-3, n_frames),
    }
    memory = {f"{name}_known": flags for name, flags in known.items()}
    for name, flags in known.items():
        vector = np.where(flags[..., None], rng.normal(0, 0.02, (n_frames, n, 2)), np.nan)
        memory |= {
            f"{name}_vector": vector.astype(np.float32),
            f"{name}_hop": rng.integers(15, size=(n_frames, n)),
        }
    return Frames(
        **{name: values.astype(dtype_of(name)) for name, values in (zero | made).items()},
        memory=memory,
    )


def joined(blocks):
    """Blocks of frames as one."""
    each = [block.arrays() for block in blocks]
    return Frames.from_arrays(
        {name: np.concatenate([arrays[name] for arrays in each]) for name in each[0]}
    )


def cut(frames, start, stop):
    return frames[start:stop]


def write(path, scene, frames, cuts=(1, 6, 23), config=None):
    with closing(Recording(path, scene, config or {}, {})) as recording:
        for start, stop in zip((0, *cuts), (*cuts, len(frames)), strict=True):
            recording.append(cut(frames, start, stop))


def column(recorded, entity, name):
    return [np.array(row) for row in recorded[entity][name]]
