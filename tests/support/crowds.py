"""Robots so near that they meet as soon as they move. Units: mm."""

import numpy as np

from iswarm_mj.utils.units import RD


def crowd(n_worlds, rng, n_robots=25):
    """Return robots on distinct cells (B, N, 3), at random headings."""
    places = (np.arange(7) - 3) * RD
    cells = np.stack(np.meshgrid(places, places), -1).reshape(-1, 2)
    xy = np.stack([cells[rng.permutation(len(cells))[:n_robots]] for _ in range(n_worlds)])
    yaw = rng.uniform(-np.pi, np.pi, (n_worlds, n_robots))
    return np.dstack([xy, yaw])
