"""Too little room for contacts in MJX. Units: mm."""

import jax
import jax.numpy as jnp
import numpy as np

from iswarm_mj.config.swarm import ArenaConfig, SwarmConfig
from iswarm_mj.engines.base import Phase
from iswarm_mj.engines.mjx.arena import ContactCapacity, compile_mjx_arena
from iswarm_mj.engines.mjx.engine import MjxEngine
from iswarm_mj.utils.errors import FaultKind

N = 40
SMALL = SwarmConfig(arena=ArenaConfig(size=10, dump_size=2, dust_area_size=1, dust_area_offset=3.5, n_dust=2))


def test_too_little_room_is_said():
    """20 pairs and 30 contact points, for 67 pairs that are near but do not touch, 10 pairs that do, and none.

    Also where there is room again at the end, as in the last world, whose robots go apart.
    """
    near, touching, free, parting = np.zeros((4, N, 3), np.float32)
    grid = np.arange(N) % 7, np.arange(N) // 7
    near[:, :2] = np.column_stack(grid) * 2.4 - 7
    free[:, :2] = np.column_stack(grid) * 3.0 - 9
    touching[:] = free
    touching[np.arange(1, N, 4), 0] -= 1.1
    parting[:, :2] = np.column_stack(grid) * 2.8 - 8.4
    poses, velocity = np.stack([near, touching, free, parting]), np.zeros((4, N, 3), np.float32)
    velocity[3] = parting / 8.4
    small = compile_mjx_arena(SMALL, N, "jax", 4, ContactCapacity(pairs=20, contacts=30))
    engine = MjxEngine(small, SMALL, False)

    @jax.jit
    @jax.vmap
    def moved(poses, velocity):
        bodies = engine.place(poses, jnp.ones(N, bool))
        return engine.move(bodies, [Phase(10, lambda _: velocity)], jnp.bool_(True))

    motion, full = moved(poses, velocity), FaultKind.TOO_MANY_PAIRS
    assert motion.fault.tolist() == [full, FaultKind.TOO_MANY_CONTACTS, 0, full]
    np.testing.assert_array_equal(motion.bodies.poses, poses)
