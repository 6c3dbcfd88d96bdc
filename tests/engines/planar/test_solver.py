"""The contact solver of the planar engine on islands of contacts."""

from pathlib import Path

import numpy as np
from support.compiled import for_python

from iswarm_mj.config.swarm import SwarmConfig
from iswarm_mj.engines.arena import compile_arena
from iswarm_mj.engines.planar import solver
from iswarm_mj.engines.planar.plane import read_kinds, read_plane, table_of

solve_island = for_python(solver.solve_island)
CYCLE = Path(__file__).parents[2] / "data" / "island_that_cycles.npz"
"""Contacts of 725 pairs in a crowd that filled the arena, and the velocities before the sweeps."""
TOLERANCE = 0.1
"""Change of a velocity at which sweeps end [mm/s]."""


def sweeps_of_cycle(**changes):
    """Return the number of sweeps for the island, with other numbers of the plane."""
    with np.load(CYCLE) as saved:
        contacts = saved["contacts"]
        velocities = saved["velocities"]
    arena = compile_arena(SwarmConfig(), None, np.zeros(0))
    n_bodies = len(velocities) - 1
    kinds = table_of(read_kinds(arena), arena.robot, n_bodies)
    plane = read_plane(arena, TOLERANCE)._replace(**changes)
    members = np.arange(len(contacts))
    return solve_island(members, contacts, velocities, np.zeros((n_bodies, 3)), kinds, plane)


def test_momentum_does_not_run_in_circles():
    """Without restarts it took 10,013 sweeps: momentum stopped after half of the most."""
    assert 0 < sweeps_of_cycle() < 200


def test_sweeps_that_do_not_converge_return_zero():
    assert sweeps_of_cycle(max_sweeps=3) == 0
