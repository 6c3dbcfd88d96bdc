"""Light in MuJoCo in C: rays of the physics engine find links, walls and obstacles in sight."""

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

_SHORTEST_RAY = 1e-9
"""Length that MuJoCo needs of a ray [mm]."""

_RAY_GROUPS = np.array([0, 0, 0, 1, 0, 0], np.uint8)
"""Groups of geoms that rays hit: hulls and walls are in group 3."""

_FAR_AWAY = 1e6
"""Distance at which links of absent robots are looked for, where they meet nobody [mm]."""

_ABOVE_ARENA = 1e3
"""Height above all geoms [mm]."""


class Scene:
    """Geoms that rays meet in the worlds of a batch.

    Attributes:
        config: arena and optics.
        robot: geometry of the robots.
        robot_of_geom: (number of geoms + 1,) index of the robot whose hull a geom is; N for other
            geoms, and in the last entry, which stands for no hit.
        walls: (W, 3) half planes of the walls, see `geometry.walls.half_planes` [mm].
    """

    def __init__(self, config: SwarmConfig, arena: ArenaModel, batch: Batch):
        self.config = config
        self.robot = arena.robot
        self.walls = arena.planes
        self.robot_of_geom = np.full(arena.model.ngeom + 1, arena.n_robots)
        self.robot_of_geom[arena.hull[: arena.n_robots]] = np.arange(arena.n_robots)
        self._n_robots = arena.n_robots
        self._body = arena.body
        self._batch = batch
        self._obstacles = numbers(config.arena.obstacles, RD)
        self._half_edges_of_boxes = numbers(config.arena.boxes, RD)[:, 4:]

    def solid(self, boxes: Float[np.ndarray, "B M 3"]) -> Float[np.ndarray, "B OM 6"]:
        """Return obstacles, and boxes at these poses, see `geometry.obstacles.numbers` [mm]."""
        return np.asarray(with_poses(self._obstacles, boxes, self._half_edges_of_boxes))

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
            Share of the vector's length at the first hit, infinite without one; and the index of
            the robot that is hit, N for anything else.
        """
        n_rays = np.bincount(world, minlength=self._batch.nsim)
        worlds = np.flatnonzero(n_rays)
        if not len(worlds):
            return np.zeros(0), np.zeros(0, int)

        # MuJoCo casts equally many rays in each world: those that fill up point at the sky.
        shape = (len(worlds), int(n_rays.max(initial=0)))
        is_ray = np.arange(shape[1]) < n_rays[worlds, None]
        start = np.zeros((*shape, 3))
        direction = np.zeros((*shape, 3))
        ignored_body = np.zeros(shape, np.int32)
        start[..., 2] = _ABOVE_ARENA
        direction[..., 2] = 1.0

        by_world = np.argsort(world, kind="stable")
        height = np.full(len(by_world), self.robot.ray_height)
        start[is_ray] = np.column_stack([origin[by_world], height])
        direction[is_ray] = np.column_stack([vector[by_world], np.zeros(len(by_world))])
        ignored_body[is_ray] = self._body[robot[by_world]]
        share_in_block, geom = self._batch.ray(
            start,
            direction,
            geomgroup=_RAY_GROUPS,
            bodyexclude=ignored_body,
            ids=worlds,
        )

        # A geom of -1 is no hit, and indexes the last entry of `robot_of_geom`.
        share = np.empty(len(world))
        robot_hit = np.empty(len(world), int)
        share[by_world] = np.where(geom[is_ray] < 0, np.inf, share_in_block[is_ray])
        robot_hit[by_world] = self.robot_of_geom[geom[is_ray]]
        return share, robot_hit

    def reaches(
        self,
        world: Int[np.ndarray, "P"],
        origin: Float[np.ndarray, "P 2"],
        target: Float[np.ndarray, "P 2"],
        receiver: Int[np.ndarray, "P"],
        sender: Int[np.ndarray, "P"],
    ) -> Bool[np.ndarray, "P"]:
        """Return the rays from photodiodes that meet no third robot first, see `links.LedHit`.

        Links do not end at walls: what little of a robot is pressed into a wall stays visible.
        """
        vector = target - origin
        has_length = np.hypot(vector[:, 0], vector[:, 1]) >= _SHORTEST_RAY
        share, robot_hit = self.cast_rays(
            world=world[has_length],
            origin=origin[has_length],
            vector=vector[has_length],
            robot=receiver[has_length],
        )
        is_third = (robot_hit < self._n_robots) & (robot_hit != sender[has_length])
        reaches = np.ones(len(world), bool)
        reaches[has_length] = ~(is_third & (share < 1.0))
        return reaches


def sense(
    scene: Scene,
    poses: Float[np.ndarray, "B N 3"],
    boxes: Float[np.ndarray, "B M 3"],
    emits: np.ndarray,
    is_present: Bool[np.ndarray, "B N"],
) -> LightReading:
    """Return the light that robots receive, see `Engine.sense`.

    Args:
        scene: the worlds.
        poses: x, y [mm] and yaw [rad] of the robots.
        boxes: x, y [mm] and yaw [rad] of the boxes.
        emits: (B, N) see `Engine.sense`.
        is_present: the other robots neither send nor receive.
    """
    if not is_present.all():
        apart = _FAR_AWAY * (1 + np.arange(poses.shape[1]))
        poses = np.where(is_present[..., None], poses, apart[:, None])
    solid = scene.solid(boxes)
    links = find_links(
        poses=poses,
        robot=scene.robot,
        optics=scene.config.optics,
        reaches=scene.reaches,
        sends=emits * is_present,
        boxes=solid,
    )
    return LightReading(links, find_walls(scene, poses, is_present, solid))


def find_walls(
    scene: Scene,
    poses: Float[np.ndarray, "B N 3"],
    is_present: Bool[np.ndarray, "B N"],
    solid: Float[np.ndarray, "B OM 6"],
) -> Bool[np.ndarray, "B N S"]:
    """Return the LEDs that have a wall, an obstacle or a box in sight.

    It is the first thing on the LED's axis, within range. An LED that a robot presses slightly
    into one sees it too.

    Args:
        scene: the worlds.
        poses: x, y [mm] and yaw [rad] of the robots.
        is_present: the other robots see nothing.
        solid: obstacles and boxes, see `Scene.solid` [mm].
    """
    sees_wall = np.zeros((*poses.shape[:2], len(scene.robot.sides)), bool)
    ray_length = max(mm_from_rd(scene.config.optics.wall_range), _SHORTEST_RAY)

    # Most robots are too far from everything.
    centres = poses[..., :2]
    reach = scene.robot.circumradius + ray_length
    may_see = beyond(centres, scene.walls) + reach > 0
    if solid.size:
        may_see |= distances(centres, solid) < reach
    world, robot = np.nonzero(may_see & is_present)
    leds = np.asarray(led_positions(poses[world, robot], scene.robot, robot))
    rays = np.asarray(led_axes(poses[world, robot], scene.robot)) * ray_length

    # Without boxes, only rays that end beyond a wall can meet anything that counts.
    needs_ray = np.full(leds.shape[:2], True)
    in_sight = beyond(leds, scene.walls) > 0
    if solid.size:
        in_sight |= distances(leds, solid[world]) == 0
    else:
        needs_ray = beyond(leds + rays, scene.walls) > 0

    index, _ = np.nonzero(needs_ray)
    share, robot_hit = scene.cast_rays(
        world=world[index],
        origin=leds[needs_ray],
        vector=rays[needs_ray],
        robot=robot[index],
    )
    n_robots = poses.shape[1]
    in_sight[needs_ray] |= (share <= 1.0) & (robot_hit >= n_robots)
    sees_wall[world, robot] = in_sight
    return sees_wall
