"""Small worlds for tests of light, memory and floor, and a slow but plain reference for links."""

import dataclasses
from typing import NamedTuple
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
"""A robot whose optics are beside the middle of its sides, elsewhere on each."""


def place(*rows):
    """Return poses (N, 3) from rows of x, y [mm] and heading [deg]."""
    return np.array([[x, y, np.radians(heading)] for x, y, heading in rows], float)


def turned(xy, angle):
    """Return vectors (..., 2) turned by `angle` (...,), by complex numbers."""
    z = (xy[..., 0] + 1j * xy[..., 1]) * np.exp(1j * np.asarray(angle))
    return np.stack([z.real, z.imag], axis=-1)


def wrapped(angle):
    """Return an angle as one within -pi to pi."""
    return np.angle(np.exp(1j * np.asarray(angle)))


def remember(vector, hop=0, known=True):
    """Return memories of vectors (..., 2), empty where not `known`."""
    vector = np.asarray(vector, np.float32)
    known = np.broadcast_to(known, vector.shape[:-1])
    hop = np.where(known, hop, 0).astype(np.int32)
    return VectorMemory(np.where(known[..., None], vector, np.float32(0)), hop, known)


def senses_nothing(n, sides=4):
    """Return an observation of N robots that sense nothing; tests `_replace` some of it."""
    no_robot = np.zeros(n, bool)
    no_side = np.zeros((n, sides), bool)
    no_vector = remember(np.zeros((n, sides, 2)), known=False)
    directions = np.float32(np.arange(sides) * (np.pi / 2))
    return Observation(
        is_heard=no_side,
        bearing=np.broadcast_to(directions, (n, sides)),
        distance=np.full((n, sides), 5.0, np.float32),
        led=np.zeros((n, sides), np.int32),
        payload={"priority": no_side, "dust": no_vector, "dump": no_vector},
        sees_wall=no_side,
        at_dust=no_robot,
        ball_vector=np.zeros((n, 2), np.float32),
        on_dump=no_robot,
        is_loaded=no_robot,
        grasp_failed=no_robot,
        sensed={},
        waits=no_robot,
    )


def lay(*positions, holders=None):
    """Return balls of the median strength.

    Args:
        positions: x and y of each ball [mm].
        holders: robot that holds each ball, None for nobody.
    """
    n_balls = len(positions)
    radius = np.full(n_balls, 20e-6)
    balls = balls_on_floor(GripperConfig(), np.array(positions, float), radius)

    holders = holders or [None] * n_balls
    is_held = np.array([holder is not None for holder in holders])
    holder_index = np.array([holder or 0 for holder in holders], np.int32)
    balls = balls._replace(is_held=is_held, holder=holder_index, was_picked=is_held)
    return jax.tree.map(jnp.asarray, balls)


def crowd(rng, density, edge=9):
    """Return poses of edge^2 robots that do not overlap, like bricks in a wall.

    Args:
        rng: random generator.
        density: share of the floor that the robots cover.
        edge: number of rows, and of robots in each.
    """
    # Headings at which a square of 2 x 2 mm fits into its cell.
    cell = 2 / np.sqrt(density)
    yaw = []
    while len(yaw) < edge**2:
        angle = rng.uniform(-np.pi, np.pi)
        half_width = abs(np.cos(angle)) + abs(np.sin(angle))
        if half_width <= cell / 2:
            yaw.append(angle)
    yaw = np.array(yaw)

    # Rows of cells that are shifted against each other, with a robot anywhere in each cell.
    places = np.arange(edge) - edge / 2
    centres = np.stack(np.meshgrid(places, places), -1).reshape(-1, 2) * cell
    centres[:, 0] += np.repeat(rng.uniform(0, cell, edge), edge)
    slack = cell / 2 - abs(np.cos(yaw)) - abs(np.sin(yaw))
    xy = centres + rng.uniform(-1, 1, centres.shape) * slack[:, None]

    rotation = rng.uniform(-np.pi, np.pi)
    poses = np.column_stack([turned(xy, rotation), yaw + rotation])
    return poses[rng.permutation(edge**2)]


def thirds_in_the_way(rng, n, reach, size):
    """Return worlds (n, 3, 3) of a receiver, a sender at the end of its reach, and a third robot.

    The third robot is near the sender, on any side of it, or beside the path of the light.

    Args:
        rng: random generator.
        n: number of worlds.
        reach: range of the light [mm].
        size: size of the third robot [mm].
    """
    # The sender is ahead of the receiver, and one of its sides looks back at it.
    direction = rng.uniform(-np.pi, np.pi, n)
    distance = reach * rng.uniform(0.96, 1.0, n)
    poses = np.zeros((n, 3, 3))
    poses[..., 2] = rng.uniform(-np.pi, np.pi, (n, 3))
    off_beam = rng.uniform(-0.5, 0.5, n)
    side = rng.integers(0, 4, n)
    poses[:, 1, 2] = direction + off_beam + side * np.pi / 2
    poses[:, 1, 0] = distance
    poses[:, 2, 0] = distance

    # The third robot, alternately near the sender and beside the path.
    gap = np.column_stack([rng.uniform(0, 1.5 * size, n), np.zeros(n)])
    near_sender = turned(gap, rng.uniform(-1.6, 1.6, n))
    beside_path = np.column_stack([rng.uniform(-distance, 0), rng.uniform(-size, size, n)])
    is_near_sender = np.arange(n)[:, None] % 2
    poses[:, 2, :2] += np.where(is_near_sender, near_sender, beside_path)

    poses[..., :2] = turned(poses[..., :2], direction[:, None])
    return poses


def links_by_rays(*arguments):
    """Return the links that `find_links` finds when it asks `reaches` about all pairs."""

    def undecided_circles(_, which):
        n_robots = len(which)
        return Circles(outer=np.full(n_robots, np.inf), inner=np.zeros(n_robots), behind=np.inf)

    with patch.object(links, "circles_around", undecided_circles):
        return links.find_links(*arguments)


def squares_in_the_way(poses, half_edges=(1.0, 1.0)):
    """Return an exact `reaches` for worlds (B, N, 3): no third robot's rectangle meets the ray.

    Args:
        poses: of the robots.
        half_edges: of all robots, or (N, 2) of each [mm].
    """
    half_edges = np.broadcast_to(half_edges, (poses.shape[1], 2))

    def is_clear(world, origin, target, receiver, sender):
        thirds = np.delete(poses[world], [receiver, sender], axis=0)
        if not len(thirds):
            return True

        # The ray in the frame of each third robot, as shares of its length at the four edges.
        half = np.delete(half_edges, [receiver, sender], axis=0)
        start = turned(origin - thirds[:, :2], -thirds[:, 2])
        end = turned(target - thirds[:, :2], -thirds[:, 2])
        with np.errstate(divide="ignore", invalid="ignore"):
            at_edges = np.stack([(-half - start) / (end - start), (half - start) / (end - start)])
        enters = np.maximum(at_edges.min(axis=0).max(axis=1), 0)
        leaves = np.minimum(at_edges.max(axis=0).min(axis=1), 1)
        return not (enters < leaves).any()

    def reaches(*rays):
        return np.array([is_clear(*ray) for ray in zip(*rays, strict=True)], bool)

    return reaches


class Optics(NamedTuple):
    """Places and directions of a robot's light as complex numbers [mm]."""

    leds: np.ndarray
    led_axes: np.ndarray
    receivers: np.ndarray
    receiver_axes: np.ndarray


def optics_of(robot):
    """Return the optics of a robot, by default in the middle of the sides of a square."""
    if robot is None:
        quarters = np.exp(1j * np.arange(4) * np.pi / 2)
        return Optics(quarters, quarters, quarters, quarters)
    return Optics(
        leds=np.array(robot.leds) @ [1, 1j],
        led_axes=np.array(robot.sides.leds) @ [1, 1j],
        receivers=np.array(robot.receivers) @ [1, 1j],
        receiver_axes=np.array(robot.sides.photodiodes) @ [1, 1j],
    )


def all_links(poses, reaches, sector=90.0, beam=60.0, robot=None):
    """Return the links of one world by trying every pair, in sector mode.

    Args:
        poses: (N, 3) of the robots.
        reaches: casts rays.
        sector: full width of the photodiodes' sector [deg].
        beam: full width of the LEDs' beam [deg].
        robot: optics, by default those of the paper's robot.

    Returns:
        Sender and LED (N, S), -1 for none; and the number of sides whose nearest sender is hidden
        while another one is heard.
    """
    optics = optics_of(robot)
    n_robots = len(poses)
    n_sides = len(optics.receivers)
    centre = poses[:, 0] + 1j * poses[:, 1]
    heading = np.exp(1j * poses[:, 2])
    sender = np.full((n_robots, n_sides), -1)
    led = np.full((n_robots, n_sides), -1)
    passed_over = 0
    for i in range(n_robots):
        nearest_heard = np.full(n_sides, np.inf)
        nearest_hidden = np.full(n_sides, np.inf)
        is_in_range = (abs(centre - centre[i]) < RADIUS) & (np.arange(n_robots) != i)
        for j in np.flatnonzero(is_in_range):
            # The side of i and the LED of j that look nearest at the other robot.
            offset = centre[j] - centre[i]
            off_axis = abs(np.degrees(np.angle(offset / heading[i] / optics.receiver_axes)))
            off_beam = abs(np.degrees(np.angle(-offset / heading[j] / optics.led_axes)))
            side = off_axis.argmin()
            facing_led = off_beam.argmin()
            if off_axis[side] > sector / 2 or off_beam[facing_led] > beam / 2:
                continue

            # The nearest sender whose light no third robot stops.
            origin = centre[i] + heading[i] * optics.receivers[side]
            target = centre[j] + heading[j] * optics.leds[facing_led]
            is_clear = reaches(
                np.array([0]),
                np.array([[origin.real, origin.imag]]),
                np.array([[target.real, target.imag]]),
                np.array([i]),
                np.array([j]),
            )
            distance = abs(offset)
            if not is_clear[0]:
                nearest_hidden[side] = min(nearest_hidden[side], distance)
            elif distance < nearest_heard[side]:
                nearest_heard[side] = distance
                sender[i, side] = j
                led[i, side] = facing_led

        hears = np.isfinite(nearest_heard)
        passed_over += int((nearest_hidden < nearest_heard)[hears].sum())
    return sender, led, passed_over
