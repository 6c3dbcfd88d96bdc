"""Both implementations of the planar engine on the same small crowds. Units: mm, s."""

from dataclasses import replace

import jax
import numpy as np

from iswarm_mj.engines.arena import compile_arena
from iswarm_mj.engines.base import Phase
from iswarm_mj.engines.planar.engine import PlanarEngine
from iswarm_mj.engines.planar.reception import points_of, read_light
from iswarm_mj.engines.settings import REFINEMENT


def placed(engine, poses, present=None):
    """Return bodies at rest at poses (B, N, 3), all of them present by default."""
    poses = np.asarray(poses, float)
    return engine.place(poses, np.ones(poses.shape[:2], bool) if present is None else present)


def moved(engine, bodies, velocity, n_substeps=10, running=None):
    """Return the motion of all worlds, or those `running`, with servos set to `velocity`."""
    velocity = np.broadcast_to(np.asarray(velocity, float), bodies.poses.shape)
    running = np.ones(len(bodies.poses), bool) if running is None else np.asarray(running)
    return engine.move(bodies, [Phase(n_substeps, lambda _: velocity)], running)


def both_engines(config, refinement=REFINEMENT, tune=None, **changes):
    """Return the engine for CPUs and the one for batches.

    Args:
        config: arena and optics.
        refinement: see `compile_arena`.
        tune: see `compile_arena`.
        changes: numbers that replace those of their planes.
    """
    # Only the tests that need Warp import it.
    from iswarm_mj.engines.planar.batch_engine import read_engine

    arena = compile_arena(config, 1, np.zeros(0), refinement=refinement, tune=tune)
    plain = PlanarEngine(config, arena, 1)
    plain.plane = plain.plane._replace(**changes)
    batch = read_engine(arena, config, jax.default_backend())
    return plain, replace(batch, plane=batch.plane._replace(**changes))


def as_mujoco(engine):
    """Return a planar engine without contacts between corners, which MuJoCo does not have."""
    plane = engine.plane._replace(corners_collide=False)
    if isinstance(engine, PlanarEngine):
        engine.plane = plane
        return engine
    return replace(engine, plane=plane)


def with_robot(engine, robot, optics):
    """Give the engine for CPUs the optics of another robot, and return it.

    Robots whose light comes from beside their hulls have no file, so that this reaches into the
    engine.
    """
    engine.robot = robot
    engine._light = read_light(robot, optics)
    engine._points = points_of(robot)
    return engine


def rounded(values):
    """Return numbers that 32-bit floats hold, as 64-bit floats."""
    return np.asarray(values, np.float32).astype(float)


def same_bits(first, second):
    """Return whether two trees of arrays hold the same bits."""
    pairs = zip(jax.tree.leaves(first), jax.tree.leaves(second), strict=True)
    return all(np.asarray(a).tobytes() == np.asarray(b).tobytes() for a, b in pairs)
