"""Three robots of another geometry in MuJoCo's C engine and in MJX, behind one interface."""

import jax
import jax.numpy as jnp
import numpy as np

from iswarm_mj.config import ArenaConfig, SwarmConfig
from iswarm_mj.engines.arena import compile_arena
from iswarm_mj.engines.base import Phase
from iswarm_mj.engines.mjx.arena import compile_mjx_arena
from iswarm_mj.engines.mjx.engine import MjxEngine
from iswarm_mj.engines.mujoco.engine import MujocoEngine

CONFIG = SwarmConfig(arena=ArenaConfig(size=10, dump_size=2, dust_area_size=1, dust_area_offset=3.5, n_dust=2))
N = 3
SENDS = np.array([True, True, False])


class InC:
    """MuJoCo in C, of one world: poses (N, 3) -> `Sight`, or `Motion`."""

    def __init__(self, file):
        arena = compile_arena(CONFIG, N, np.zeros(0), robot_file=file)
        self._engine = MujocoEngine(CONFIG, arena, 1, 1, N)

    def sense(self, poses):
        bodies = self._engine.place(poses[None], np.ones((1, N), bool))
        return first(self._engine.sense(bodies, SENDS[None], np.ones(1, bool)))

    def move(self, poses, velocity, n_substeps):
        bodies = self._engine.place(poses[None], np.ones((1, N), bool))
        return first(self._engine.move(bodies, [Phase(n_substeps, lambda _: velocity[None])], np.ones(1, bool)))


class InJax:
    """MJX-JAX likewise, one program for all tests."""

    def __init__(self, file):
        engine = MjxEngine(compile_mjx_arena(CONFIG, N, "jax", 1, robot_file=file), CONFIG, is_masked=False)
        everyone, running = jnp.ones(N, bool), jnp.array(True)
        self._sense = jax.jit(lambda poses: engine.sense(engine.place(poses, everyone), SENDS, running))
        self._move = jax.jit(
            lambda poses, velocity, n_substeps: engine.move(
                engine.place(poses, everyone), [Phase(n_substeps, lambda _: velocity)], running
            ),
            static_argnums=2,
        )

    def sense(self, poses):
        return jax.tree.map(np.asarray, self._sense(jnp.asarray(poses, jnp.float32)))

    def move(self, poses, velocity, n_substeps):
        poses, velocity = jnp.asarray(poses, jnp.float32), jnp.asarray(velocity, jnp.float32)
        return jax.tree.map(np.asarray, self._move(poses, velocity, n_substeps))


def first(tree):
    """Of the first world."""
    return jax.tree.map(lambda a: a[0], tree)
