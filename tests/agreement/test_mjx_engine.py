"""Too little room for contacts in MJX. Units: mm, s."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from iswarm_mj.config.swarm import ArenaConfig, SwarmConfig
from iswarm_mj.engines.base import Phase
from iswarm_mj.engines.mjx.arena import ContactCapacity, compile_mjx_arena
from iswarm_mj.engines.mjx.engine import MjxEngine
from iswarm_mj.utils.errors import FaultKind

N_ROBOTS = 40
N_COLUMNS = 7
SMALL = SwarmConfig(
    ArenaConfig(size=10, dump_size=2, dust_area_size=1, dust_area_offset=3.5, n_dust=2),
)


def grid(spacing, offset):
    """Return poses (N, 3) of robots at rest in rows, the first at (offset, offset)."""
    numbers = np.arange(N_ROBOTS)
    poses = np.zeros((N_ROBOTS, 3), np.float32)
    columns = np.column_stack([numbers % N_COLUMNS, numbers // N_COLUMNS])
    poses[:, :2] = columns * spacing + offset
    return poses


@pytest.mark.slow
def test_too_little_room_is_a_fault():
    """There is room for 20 pairs and 30 contact points; worlds have 67 near pairs, 10 that touch,
    and none.

    It is a fault even if there is room again at the end, as in the last world, whose robots part.
    """
    near = grid(2.5, -7)
    free = grid(3.4, -10.2)
    touching = free.copy()
    touching[np.arange(1, N_ROBOTS, 4), 0] -= 1.5
    parting = grid(2.8, -8.4)
    poses = np.stack([near, touching, free, parting])
    velocity = np.zeros_like(poses)
    velocity[3] = parting / 8.4

    capacity = ContactCapacity(pairs=20, contacts=30)
    arena = compile_mjx_arena(SMALL, N_ROBOTS, "jax", 4, capacity)
    engine = MjxEngine(arena, SMALL, False)

    @jax.jit
    @jax.vmap
    def move(poses, velocity):
        bodies = engine.place(poses, jnp.ones(N_ROBOTS, bool))
        return engine.move(bodies, [Phase(10, lambda _: velocity)], jnp.bool_(True))

    motion = move(poses, velocity)
    pairs = FaultKind.TOO_MANY_PAIRS
    contacts = FaultKind.TOO_MANY_CONTACTS
    assert motion.fault.tolist() == [pairs, contacts, 0, pairs]
    np.testing.assert_array_equal(motion.bodies.poses, poses)
