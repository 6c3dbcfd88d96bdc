"""Small worlds for the tests of light, memory and floor, and a slow but plain reference for the links."""

import dataclasses
from unittest.mock import patch

import jax
import jax.numpy as jnp
import numpy as np

from iswarm_mj.config.swarm import GripperConfig
from iswarm_mj.engines.arena import read_robot
from iswarm_mj.sensors import links
from iswarm_mj.sensors.memory import VectorMemory
from iswarm_mj.sensors.occlusion import Circles
from iswarm_mj.strategy.interface import Observation
from iswarm_mj.tasks.layout import balls_on_floor
from iswarm_mj.utils.units import RD

RADIUS = 3.5 * RD
"""Range of light messages [mm]."""

SHIFTED = dataclasses.replace(
    read_robot(),
    leds=((1.0, 0.3), (-0.2, 1.0), (-1.0, 0.5), (0.4, -1.0)),
    photodiodes=(
        ((1.0, -0.6), (1.0, -0.2)),
        ((0.1, 1.0), (0.5, 1.0)),
        ((-1.0, 0.2), (-1.0, 0.8)),
        ((0.0, -1.0), (0.2, -1.0)),
    ),
)
"""A robot whose optics sit beside the middle of its sides, elsewhere on each."""


def place(*rows):
    """Poses (N, 3) from rows of x, y [mm] and heading [deg]."""
    return np.array([[x, y, np.radians(heading)] for x, y, heading in rows], float)


def turned(xy, angle):
    """Vectors (..., 2) turned by `angle` (...,), by complex numbers."""
    z = (xy[..., 0] + 1j * xy[..., 1]) * np.exp(1j * np.asarray(angle))
    return np.stack([z.real, z.imag], axis=-1)


def wrapped(angle):
    """Angle within -pi to pi."""
    return np.angle(np.exp(1j * np.asarray(angle)))


def remember(vector, hop=0, known=True):
    """Memories of vectors (..., 2), empty where not `known`."""
    vector = np.asarray(vector, np.float32)
    known = np.broadcast_to(known, vector.shape[:-1])
    hop = np.where(known, hop, 0).astype(np.int32)
    return VectorMemory(np.where(known[..., None], vector, np.float32(0)), hop, known)


def senses_nothing(n, sides=4):
    """Observation of N robots that neither hear nor feel anything; use `_replace`."""
    no, never = np.zeros(n, bool), np.zeros((n, sides), bool)
    silence = remember(np.zeros((n, sides, 2)), known=False)
    bearing = np.broadcast_to(np.float32(np.arange(sides) * (np.pi / 2)), (n, sides))
    return Observation(
        is_heard=never,
        bearing=bearing,
        distance=np.full((n, sides), 5.0, np.float32),
        led=np.zeros((n, sides), np.int32),
        payload={"priority": never, "dust": silence, "dump": silence},
        sees_wall=never,
        at_dust=no,
        ball_vector=np.zeros((n, 2), np.float32),
        on_dump=no,
        is_loaded=no,
        grasp_failed=no,
        sensed={},
        waits=no,
    )


def lay(*positions, holders=None):
    """Balls of the median strength at `positions`; `holders` lists who holds each, None for nobody."""
    k = len(positions)
    holders = holders or [None] * k
    balls = balls_on_floor(GripperConfig(), np.array(positions, float), np.full(k, 20e-6))
    held = np.array([h is not None for h in holders])
    holder = np.array([h or 0 for h in holders], np.int32)
    balls = balls._replace(is_held=held, holder=holder, was_picked=held)
    return jax.tree.map(jnp.asarray, balls)


def crowd(rng, density, edge=9):
    """Poses of edge^2 robots that cover a share `density` of the floor and do not overlap: like bricks in a wall."""
    cell = 2 / np.sqrt(density)
    yaw = []
    while len(yaw) < edge**2:  # a square at this angle is 2 (|cos| + |sin|) wide
        angle = rng.uniform(-np.pi, np.pi)
        if abs(np.cos(angle)) + abs(np.sin(angle)) <= cell / 2:
            yaw.append(angle)
    yaw = np.array(yaw)
    slack = cell / 2 - abs(np.cos(yaw)) - abs(np.sin(yaw))
    grid = np.stack(np.meshgrid(*[np.arange(edge) - edge / 2] * 2), -1).reshape(-1, 2) * cell
    grid[:, 0] += np.repeat(rng.uniform(0, cell, edge), edge)
    xy = grid + rng.uniform(-1, 1, grid.shape) * slack[:, None]
    whole = rng.uniform(-np.pi, np.pi)
    return np.column_stack([turned(xy, whole), yaw + whole])[rng.permutation(edge**2)]


def thirds_in_the_way(rng, n, reach, size):
    """Worlds (n, 3, 3) of a receiver, a sender at the end of its `reach` [mm], and a robot of about `size` [mm].

    It stands near the sender, on any side of it, or beside the path of the light.
    """
    way, far = rng.uniform(-np.pi, np.pi, n), reach * rng.uniform(0.96, 1.0, n)
    poses = np.zeros((n, 3, 3))
    poses[..., 2] = rng.uniform(-np.pi, np.pi, (n, 3))
    poses[:, 1, 2] = way + rng.uniform(-0.5, 0.5, n) + rng.integers(0, 4, n) * np.pi / 2
    poses[:, 1, 0] = poses[:, 2, 0] = far
    near = turned(np.column_stack([rng.uniform(0, 1.5 * size, n), np.zeros(n)]), rng.uniform(-1.6, 1.6, n))
    beside = np.column_stack([rng.uniform(-far, 0), rng.uniform(-size, size, n)])
    poses[:, 2, :2] += np.where(np.arange(n)[:, None] % 2, near, beside)
    poses[..., :2] = turned(poses[..., :2], way[:, None])
    return poses


def links_by_rays(*given):
    """What `find_links` returns if it asks `reaches` about all pairs, whatever stands in between."""

    def all_open(_, which):
        return Circles(np.full(len(which), np.inf), np.zeros(len(which)), np.inf)

    with patch.object(links, "circles_around", all_open):
        return links.find_links(*given)


def squares_in_the_way(poses, half_edges=(1.0, 1.0)):
    """Exact `reaches` for worlds (B, N, 3): no third robot's rectangle, 2 x 2 mm by default, meets the segment."""
    halves = np.broadcast_to(half_edges, (poses.shape[1], 2))

    def one(world, origin, target, receiver, sender):
        third, half = (np.delete(a, [receiver, sender], axis=0) for a in (poses[world], halves))
        a, b = (turned(end - third[:, :2], -third[:, 2]) for end in (origin, target))
        with np.errstate(divide="ignore", invalid="ignore"):
            cuts = np.stack([(-half - a) / (b - a), (half - a) / (b - a)])
        enters = np.maximum(cuts.min(axis=0).max(axis=1), 0) if len(third) else np.zeros(0)
        leaves = np.minimum(cuts.max(axis=0).min(axis=1), 1) if len(third) else np.zeros(0)
        return not (enters < leaves).any()

    def reaches(*pairs):
        return np.array([one(*pair) for pair in zip(*pairs, strict=True)], bool)

    return reaches


def all_links(poses, reaches, sector=90.0, beam=60.0, robot=None):
    """Links of one world (N, 3) by trying every pair, in sector mode: sender and LED (N, S), -1 for none.

    Also the number of sides whose nearest sender is hidden while another one is heard. Angles and points are complex
    numbers, by default those of four LEDs and photodiodes in the middle of the sides of a square.
    """
    quarters = np.exp(1j * np.arange(4) * np.pi / 2)
    leds = receivers = led_axes = axes = quarters
    if robot is not None:
        leds, receivers, led_axes, axes = (
            np.array(points) @ [1, 1j]
            for points in (robot.leds, robot.receivers, robot.sides.leds, robot.sides.photodiodes)
        )
    n, n_sides = len(poses), len(axes)
    at, heading = poses[:, 0] + 1j * poses[:, 1], np.exp(1j * poses[:, 2])
    sender, led, passed_over = np.full((n, n_sides), -1), np.full((n, n_sides), -1), 0
    for i in range(n):
        heard_at, hidden_at = np.full(n_sides, np.inf), np.full(n_sides, np.inf)
        for j in np.flatnonzero((abs(at - at[i]) < RADIUS) & (np.arange(n) != i)):
            distance = abs(at[j] - at[i])
            off_axis = abs(np.degrees(np.angle((at[j] - at[i]) / heading[i] / axes)))
            off_beam = abs(np.degrees(np.angle((at[i] - at[j]) / heading[j] / led_axes)))
            side, shines = off_axis.argmin(), off_beam.argmin()
            if off_axis[side] > sector / 2 or off_beam[shines] > beam / 2:
                continue
            ends = at[i] + heading[i] * receivers[side], at[j] + heading[j] * leds[shines]
            ends = [np.array([[end.real, end.imag]]) for end in ends]
            if not reaches(np.array([0]), *ends, np.array([i]), np.array([j]))[0]:
                hidden_at[side] = min(hidden_at[side], distance)
            elif distance < heard_at[side]:
                heard_at[side], sender[i, side], led[i, side] = distance, j, shines
        passed_over += int((hidden_at < heard_at)[np.isfinite(heard_at)].sum())
    return sender, led, passed_over
