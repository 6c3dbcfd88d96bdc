"""Light in MuJoCo in C: links, walls and obstacles in sight, decided by the rays of the physics engine."""

import numpy as np
from jaxtyping import Bool, Float, Int
from mujoco.batch import Batch

from iswarm_mj.config.swarm import SwarmConfig
from iswarm_mj.engines.arena import ArenaModel
from iswarm_mj.engines.base import LightReading
from iswarm_mj.geometry.obstacles import distances, numbers, with_poses
from iswarm_mj.geometry.walls import beyond
from iswarm_mj.sensors.links import find_links
from iswarm_mj.sensors.optics import led_axes, led_positions
from iswarm_mj.utils.units import RD, mm_from_rd

_SHORTEST = 1e-9
"""Length of a ray at least, which MuJoCo needs [mm]."""
_RAY_GROUPS = np.array([0, 0, 0, 1, 0, 0], np.uint8)  # hulls and walls are in group 3
_FAR = 1e6  # where robots are looked for that a world does not have [mm]


class Scene:
    """What rays meet in the worlds of a batch, and what it means."""

    def __init__(self, config: SwarmConfig, arena: ArenaModel, batch: Batch):
        self.config, self.robot, self._body, self._batch = config, arena.robot, arena.body, batch
        n = arena.n_robots
        self.object_of = np.full(arena.model.ngeom + 1, 2 * n + 1)
        """Robot that a geom is, or a number from N on for what is none; the last entry stands for no hit."""
        self.object_of[arena.hull[:n]] = np.arange(n)
        solid = np.concatenate([arena.walls, arena.obstacles, arena.hull[n:]])
        self.object_of[solid] = n + np.arange(len(solid))
        self._fixed, self._size = numbers(config.arena.obstacles, RD), numbers(config.arena.boxes, RD)[:, 4:]
        self.walls = arena.planes
        """(W, 3) see `utils.walls.half_planes` [mm]."""

    def solid(self, boxes: Float[np.ndarray, "B M 3"]) -> Float[np.ndarray, "B OM 6"]:
        """Return obstacles and boxes at these poses, see `utils.obstacles.numbers` [mm]."""
        return np.asarray(with_poses(self._fixed, boxes, self._size))

    def cast_rays(
        self,
        world: Int[np.ndarray, "P"],
        origin: Float[np.ndarray, "P 2"],
        vector: Float[np.ndarray, "P 2"],
        robot: Int[np.ndarray, "P"],
    ) -> tuple[Float[np.ndarray, "P"], Int[np.ndarray, "P"]]:
        """Cast horizontal rays at half the robots' height; each ignores the robot that sends it.

        Args:
            world: index of the world.
            origin: start [mm].
            vector: direction and length [mm].
            robot: index of the robot to ignore.

        Returns:
            Share of the vector's length at the first hit, infinite for none; and what is hit: the index
            of a robot, or a number from N on for a wall, an obstacle or a box.
        """
        count = np.bincount(world, minlength=self._batch.nsim)
        ids = np.flatnonzero(count)
        shape = (len(ids), int(count.max(initial=0)))
        if not len(ids):
            return np.zeros(0), np.zeros(0, int)
        used = np.arange(shape[1]) < count[ids, None]
        order = np.argsort(world, kind="stable")
        start, along = np.zeros((*shape, 3)), np.zeros((*shape, 3))
        start[..., 2], along[..., 2] = 1e3, 1.0  # rays that fill up the block point at the sky
        exclude = np.zeros(shape, np.int32)
        start[used] = np.column_stack([origin[order], np.full(len(order), self.robot.ray_height)])
        along[used] = np.column_stack([vector[order], np.zeros(len(order))])
        exclude[used] = self._body[robot[order]]
        hit_at, geom = self._batch.ray(start, along, geomgroup=_RAY_GROUPS, bodyexclude=exclude, ids=ids)
        share, hit = np.empty(len(world)), np.empty(len(world), int)
        share[order] = np.where(geom[used] < 0, np.inf, hit_at[used])
        hit[order] = self.object_of[geom[used]]
        return share, hit

    def reaches(
        self,
        world: Int[np.ndarray, "P"],
        origin: Float[np.ndarray, "P 2"],
        target: Float[np.ndarray, "P 2"],
        receiver: Int[np.ndarray, "P"],
        sender: Int[np.ndarray, "P"],
    ) -> Bool[np.ndarray, "P"]:
        """Whether light from the receivers' photodiodes would meet nothing before the senders' LEDs, see `LedHit`."""
        share, hit = self.cast_rays(world, origin, target - origin, receiver)
        return (hit == sender) | (share >= 1.0)


def sense(
    scene: Scene,
    poses: Float[np.ndarray, "B N 3"],
    boxes: Float[np.ndarray, "B M 3"],
    emits: np.ndarray,
    is_present: Bool[np.ndarray, "B N"],
) -> LightReading:
    """Light of a control step, see `Engine.sense`; robots that are not present do not take part."""
    if not is_present.all():
        away = _FAR * (1 + np.arange(poses.shape[1]))
        poses = np.where(is_present[..., None], poses, away[:, None])
    solid = scene.solid(boxes)
    links = find_links(poses, scene.robot, scene.config.optics, scene.reaches, emits * is_present, solid)
    return LightReading(links, find_walls(scene, poses, is_present, solid))


def find_walls(
    scene: Scene, poses: Float[np.ndarray, "B N 3"], is_present: Bool[np.ndarray, "B N"], solid: np.ndarray
) -> Bool[np.ndarray, "B N S"]:
    """Whether a wall, or one of what else is `solid`, is the first thing on the axis of each LED, within range.

    A LED that a robot presses slightly into a wall sees it too.
    """
    length = max(mm_from_rd(scene.config.optics.wall_range), _SHORTEST)
    sees = np.zeros((*poses.shape[:2], len(scene.robot.sides)), bool)
    reach = scene.robot.circumradius + length
    may_see = beyond(poses[..., :2], scene.walls) + reach > 0
    if solid.size:
        may_see |= distances(poses[..., :2], solid) < reach
    world, robot = np.nonzero(may_see & is_present)
    leds = np.asarray(led_positions(poses[world, robot], scene.robot, robot))
    outward = np.asarray(led_axes(poses[world, robot], scene.robot)) * length
    asked = beyond(leds + outward, scene.walls) > 0
    if solid.size:  # rays tell
        asked[:] = True
    near, _ = np.nonzero(asked)
    share, hit = scene.cast_rays(world[near], leds[asked], outward[asked], robot[near])
    found = beyond(leds, scene.walls) > 0
    if solid.size:
        found |= distances(leds, solid[world]) == 0
    found[asked] |= (share <= 1.0) & (hit >= poses.shape[1])
    sees[world, robot] = found
    return sees
