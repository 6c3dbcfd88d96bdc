"""A made-up run of a swarm, and its recording."""

import numpy as np

from iswarm_mj.output.message_columns import stored
from iswarm_mj.output.rerun_swarm import Recording
from iswarm_mj.output.schema import ARRAYS, Frames, axes_of, dtype_of
from iswarm_mj.output.trajectory import Scene
from iswarm_mj.strategy.vector_strategy import payload_for

PERIOD = 0.4


def make_scene(n_robots=40, n_balls=12):
    rng = np.random.default_rng(1)
    return Scene(
        robot_size=np.array([2e-3, 2e-3, 1e-3]),
        is_scout=rng.random(n_robots) < 0.15,
        ball_radius=np.full(n_balls, 20e-6),
        arena_size=98e-3,
        dump=np.array([-7e-3, -7e-3, 7e-3, 7e-3]),
        dust_areas=np.array([[-45e-3, 20e-3, -20e-3, 45e-3], [22e-3, -45e-3, 45e-3, -22e-3]]),
        control_period=PERIOD,
        is_alive=np.ones(n_robots, bool),
        payload=stored(payload_for(140.0)),
        world=0,
        n_leds=4,
        memory_names=("dust_vector", "dust_known", "dump_vector", "dump_known", "dust_hop", "dump_hop"),
        memory_units=("m", "", "m", "", "", ""),
        memory_sizes=(2, 1, 2, 1, 1, 1),
    )


def make_frames(scene, n_frames=50, seed=0):
    """Random walks: robots load in the dust areas, head for the dump, and drop their ball there."""
    rng, more = np.random.default_rng(seed), np.random.default_rng([seed, 1])
    n, k = len(scene.is_scout), len(scene.ball_radius)
    half = scene.arena_size / 2 - 2e-3
    areas = np.asarray(scene.dust_areas)
    area = rng.integers(len(areas), size=k)
    balls = np.column_stack([rng.uniform(areas[area, :2], areas[area, 2:]), np.full(k, 20e-6)])
    side = int(np.ceil(np.sqrt(n)))
    grid = np.stack(np.meshgrid(*[np.linspace(-half, half, side)] * 2), -1).reshape(-1, 2)
    xy = grid[rng.permutation(side**2)[:n]].copy()
    yaw = rng.uniform(-np.pi, np.pi, n)
    ball_of, state = np.full(n, -1), np.zeros(k, np.uint8)
    knows = np.zeros((2, n), bool)
    middles = (areas[:, :2] + areas[:, 2:]) / 2
    picked = collisions = 0
    blocks = []
    for step in range(n_frames):
        goal = np.where((np.arange(n) % 2)[:, None] > 0, middles[0], middles[-1])
        if step:
            loaded = ball_of >= 0
            aim = np.where(loaded[:, None], -xy, goal - xy)
            follow = loaded | (knows[0] & ~scene.is_scout & (rng.random(n) < 0.4))
            yaw = np.where(follow, np.arctan2(aim[:, 1], aim[:, 0]), yaw) + rng.normal(0, 0.35, n)
            moved = xy + 0.4e-3 * np.stack([np.cos(yaw), np.sin(yaw)], -1)
            gap = np.linalg.norm(moved[:, None] - moved[None], axis=-1) + 1e3 * np.eye(n)
            near = (gap < 2.4e-3) & (gap < np.linalg.norm(xy[:, None] - xy[None], axis=-1))
            blocked = (near & (rng.random((n, n)) < 0.9)).any(1) | (np.abs(moved) > half).any(1)
            xy = np.where(blocked[:, None], xy, moved)
            yaw = np.where(blocked, yaw + rng.normal(0, 1.5, n), yaw)
            collisions += int(near.sum() * 0.05)
            for i in np.flatnonzero(~loaded & ~scene.is_scout):
                reach = np.linalg.norm(balls[:, :2] - xy[i], axis=1) + 9.0 * (state != 0)
                j = int(np.argmin(reach))
                if reach[j] < 1.2e-3:
                    ball_of[i], state[j], picked = j, 1, picked + 1
            for i in np.flatnonzero(ball_of >= 0):
                balls[ball_of[i], :2] = xy[i]
                if np.abs(xy[i]).max() < 6e-3:
                    state[ball_of[i]], ball_of[i] = 2, -1
        distance = np.linalg.norm(xy[:, None] - xy[None], axis=-1) + 9 * np.eye(n)
        nearest = np.argsort(distance, axis=1)[:, :4]
        valid = (np.take_along_axis(distance, nearest, 1) < 7e-3) & (rng.random((n, 4)) < 0.3)
        knows |= (valid & (rng.random((n, 4)) < 0.15)).any(1) & (rng.random((2, n)) < 0.8)
        knows &= rng.random((2, n)) > 0.02
        cos, sin = np.cos(yaw), np.sin(yaw)
        body = []
        for (dx, dy), known in zip(((goal - xy).T, -xy.T), knows, strict=True):
            vector = np.stack([cos * dx + sin * dy, -sin * dx + cos * dy], -1)
            body.append(np.where(known[:, None], vector, np.nan))
        one = {
            "step": np.int32(step),
            "pose": np.column_stack([xy, yaw]).astype(np.float32),
            "is_running": np.bool_(True),
            "message": more.integers(2**32, size=n, dtype=np.uint32),
            "command": more.normal(0, [0.5, 1e-3], (n, 2)).astype(np.float32),
            "is_loaded": ball_of >= 0,
            "has_priority": (ball_of >= 0) & (np.arange(n) % 3 > 0),
            "ball_position": balls.astype(np.float32),
            "ball_state": state.copy(),
            "link_sender": np.where(valid, nearest, -1).astype(np.int16),
            "link_valid": valid,
            "link_led": more.integers(4, size=(n, 4), dtype=np.uint8),
            "link_bearing": more.normal(size=(n, 4)).astype(np.float32),
            "link_distance": more.random((n, 4), np.float32),
            "link_heard": valid & (more.random((n, 4)) < 0.8),
            "ball_holder": np.zeros(k, np.int16),
            "delivered": np.int32((state == 2).sum()),
            "picked": np.int32(picked),
            "collisions": np.int32(collisions),
            "mean_speed": np.float32(0.9e-3 + 1e-4 * rng.normal()),
        }
        memory = {
            "dust_vector": body[0].astype(np.float32),
            "dust_known": knows[0].copy(),
            "dump_vector": body[1].astype(np.float32),
            "dump_known": knows[1].copy(),
            "dust_hop": more.integers(15, size=n),
            "dump_hop": more.integers(15, size=n),
        }
        sizes = {"N": n, "K": k, "S": 4}
        for name in ARRAYS.keys() - one.keys():
            one[name] = np.zeros([sizes[axis] for axis in axes_of(name)[1:]], dtype_of(name))
        many = {name: value[None] for name, value in one.items()}
        blocks.append(Frames(**many, memory={name: value[None] for name, value in memory.items()}))
    return joined(blocks)


def joined(blocks):
    """Blocks of frames as one."""
    each = [block.arrays() for block in blocks]
    return Frames.of({name: np.concatenate([arrays[name] for arrays in each]) for name in each[0]})


def cut(frames, start, stop):
    return frames[start:stop]


def write(path, scene, frames, cuts=(1, 6, 23), config=None, lanes=()):
    with Recording(path, scene, config or {}, {}, lanes=lanes) as recording:
        for start, stop in zip((0, *cuts), (*cuts, len(frames)), strict=True):
            recording.append(cut(frames, start, stop))


def column(recorded, entity, name):
    return [np.array(row) for row in recorded[entity][name]]
