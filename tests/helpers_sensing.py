"""Small worlds for the tests of light, memory and floor, and a slow but plain reference for the links."""

import dataclasses

import jax.numpy as jnp
import numpy as np

from iswarm_mj.engines.arena import read_robot
from iswarm_mj.gripper.handling import Balls
from iswarm_mj.sensors.memory import VectorMemory
from iswarm_mj.strategy.interface import Observation
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
    vector = jnp.asarray(vector, jnp.float32)
    shape = vector.shape[:-1]
    memory = VectorMemory(vector, jnp.broadcast_to(jnp.asarray(hop, jnp.int32), shape), jnp.ones(shape, bool))
    return memory.where(jnp.broadcast_to(jnp.asarray(known), shape))


def senses_nothing(n, sides=4):
    """Observation of N robots that neither hear nor feel anything; use `_replace`."""
    no, never = jnp.zeros(n, bool), jnp.zeros((n, sides), bool)
    silence = remember(jnp.zeros((n, sides, 2)), known=False)
    bearing = jnp.broadcast_to(jnp.arange(sides) * (jnp.pi / 2), (n, sides))
    return Observation(
        is_heard=never,
        bearing=bearing,
        distance=jnp.full((n, sides), 5.0),
        led=jnp.zeros((n, sides), jnp.int32),
        priority=never,
        dust=silence,
        dump=silence,
        sees_wall=never,
        at_dust=no,
        ball_vector=jnp.zeros((n, 2)),
        on_dump=no,
        is_loaded=no,
        grasp_failed=no,
    )


def lay(*positions, holders=None):
    """Balls of the median strength at `positions`; `holders` lists who holds each, None for nobody."""
    k = len(positions)
    holders = holders or [None] * k
    return Balls(
        position=jnp.asarray(positions, jnp.float32),
        radius=jnp.full(k, 20e-6),
        work_tool_object=jnp.full(k, 1.41e-3),
        work_object_substrate=jnp.full(k, 14.7e-3),
        is_held=jnp.array([h is not None for h in holders]),
        is_delivered=jnp.zeros(k, bool),
        holder=jnp.array([h or 0 for h in holders], jnp.int32),
        was_picked=jnp.array([h is not None for h in holders]),
        carried_steps=jnp.zeros(k, jnp.int32),
    )


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


def squares_in_the_way(poses):
    """Exact `reaches` for worlds (B, N, 3): no third robot's 2 x 2 mm square meets the segment."""

    def one(world, origin, target, receiver, sender):
        third = np.delete(poses[world], [receiver, sender], axis=0)
        a, b = (turned(end - third[:, :2], -third[:, 2]) for end in (origin, target))
        with np.errstate(divide="ignore", invalid="ignore"):
            cuts = np.stack([(-1 - a) / (b - a), (1 - a) / (b - a)])
        enters = np.maximum(cuts.min(axis=0).max(axis=1), 0) if len(third) else np.zeros(0)
        leaves = np.minimum(cuts.max(axis=0).min(axis=1), 1) if len(third) else np.zeros(0)
        return not (enters < leaves).any()

    def reaches(*pairs):
        return np.array([one(*pair) for pair in zip(*pairs, strict=True)], bool)

    return reaches


def all_links(poses, reaches, sector=90.0, beam=60.0):
    """Links of one world (N, 3) by trying every pair, in sector mode: sender and LED (N, 4), -1 for none.

    Also the number of sides whose nearest sender is hidden while another one is heard.
    """
    n = len(poses)
    offset = poses[None, :, :2] - poses[:, None, :2]
    distance = np.hypot(*np.moveaxis(offset, -1, 0))
    direction = np.arctan2(offset[..., 1], offset[..., 0])
    sender, led, passed_over = np.full((n, 4), -1), np.full((n, 4), -1), 0
    for i in range(n):
        heard_at, hidden_at = np.full(4, np.inf), np.full(4, np.inf)
        for j in np.flatnonzero((distance[i] < RADIUS) & (np.arange(n) != i)):
            at_receiver = np.degrees(direction[i, j] - poses[i, 2])
            at_sender = np.degrees(direction[j, i] - poses[j, 2])
            side, shines = round(at_receiver / 90) % 4, round(at_sender / 90) % 4
            if abs((at_receiver + 45) % 90 - 45) > sector / 2 or abs((at_sender + 45) % 90 - 45) > beam / 2:
                continue
            ends = [
                poses[k, :2] + turned(np.array([1.0, 0.0]), poses[k, 2] + s * np.pi / 2)
                for k, s in ((i, side), (j, shines))
            ]
            if not reaches(*(np.array([a]) for a in (0, *ends, i, j)))[0]:
                hidden_at[side] = min(hidden_at[side], distance[i, j])
            elif distance[i, j] < heard_at[side]:
                heard_at[side], sender[i, side], led[i, side] = distance[i, j], j, shines
        passed_over += int((hidden_at < heard_at)[np.isfinite(heard_at)].sum())
    return sender, led, passed_over
