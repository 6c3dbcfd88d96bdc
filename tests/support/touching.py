"""Pairs of robots in contact, from `Motion.touching`."""

import numpy as np


def pairs_of(touching):
    """Which pairs touch (*B, N, N) bool, upper triangle."""
    touching = np.asarray(touching)
    index = np.arange(touching.shape[-1])
    return (touching[..., None] == index).any(axis=-3) & (index[:, None] < index)
