"""Pairs of robots in contact, from `Motion.touching`."""

import numpy as np


def pairs_of(touching):
    """Return which pairs touch (*B, N, N), in the upper triangle."""
    touching = np.asarray(touching)
    index = np.arange(touching.shape[-1])
    is_partner = (touching[..., None] == index).any(axis=-3)
    return is_partner & (index[:, None] < index)
