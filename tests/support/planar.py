"""Both implementations of the planar engine on the same small crowds. Units: mm, s."""

from dataclasses import replace

import jax
import numpy as np

from iswarm_mj.engines.arena import compile_arena
from iswarm_mj.engines.base import Phase
from iswarm_mj.engines.planar.engine import PlanarEngine
from iswarm_mj.engines.planar.reception import points_of, read_light


def placed(engine, poses, present=None):
    """Bodies at rest at (B, N, 3), all present if not said otherwise."""
    poses = np.asarray(poses, float)
    return engine.place(poses, np.ones(poses.shape[:2], bool) if present is None else present)


def moved(engine, bodies, velocity, n_substeps=10, running=None):
    """Motion of all worlds, or those `running`, with servos set to `velocity`."""
    velocity = np.broadcast_to(np.asarray(velocity, float), bodies.poses.shape)
    running = np.ones(len(bodies.poses), bool) if running is None else np.asarray(running)
    return engine.move(bodies, [Phase(n_substeps, lambda _: velocity)], running)


def both_engines(config, refinement=1, tune=None, **changes):
    """The engine for CPUs and the one for batches; `changes` replace numbers of their planes."""
    from iswarm_mj.engines.planar.batch_engine import read_engine

    arena = compile_arena(config, 1, np.zeros(0), refinement=refinement, tune=tune)
    plain, batch = PlanarEngine(config, arena, 1), read_engine(arena, config, jax.default_backend())
    plain.plane = plain.plane._replace(**changes)
    return plain, replace(batch, plane=batch.plane._replace(**changes))


def with_robot(engine, robot, optics):
    """The engine for CPUs with the optics of another robot."""
    engine.robot, engine._light, engine._points = robot, read_light(robot, optics), points_of(robot)
    return engine


def rounded(values):
    """Numbers that 32-bit floats hold, as 64-bit floats."""
    return np.asarray(values, np.float32).astype(float)


def same_bits(one, other):
    """Whether two trees of arrays hold the same bits."""
    pairs = zip(jax.tree.leaves(one), jax.tree.leaves(other), strict=True)
    return all(np.asarray(a).tobytes() == np.asarray(b).tobytes() for a, b in pairs)
