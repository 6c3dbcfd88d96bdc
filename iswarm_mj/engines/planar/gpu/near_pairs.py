"""Pairs of robots near each other, as `planar.near_pairs` finds them."""

import warp as wp

from iswarm_mj.engines.planar.gpu.block import barrier
from iswarm_mj.engines.planar.gpu.cells import around, fill
from iswarm_mj.engines.planar.gpu.world import FAILURE, N_NEAR, World
from iswarm_mj.utils.errors import FaultKind

_TOO_MANY = wp.constant(int(FaultKind.TOO_MANY_PAIRS))


@wp.func
def find_near_pairs(w: World, radius: float, lane: int):
    """List the pairs of robots whose centres are less than `radius` apart [mm], each once, in any order."""
    if lane == 0:
        w.count[N_NEAR] = 0
    fill(w.cells, w.place, w.is_present, lane)
    for i in range(lane, w.place.shape[0], wp.block_dim()):
        if w.is_present[i] and i < w.n_robots:
            p = w.place[i]
            for up in range(-1, 2):
                span = around(p, w.cells, up)
                for at in range(span[0], span[1]):
                    j = w.cells.robot[at]
                    if j > i and j < w.n_robots:
                        dx, dy = w.place[j][0] - p[0], w.place[j][1] - p[1]
                        if dx * dx + dy * dy < radius * radius:
                            _append(w, wp.vec2i(i, j))
    barrier()


@wp.func
def _append(w: World, pair: wp.vec2i):
    at = wp.atomic_add(w.count, N_NEAR, 1)
    if at < w.near.shape[0]:
        w.near[at] = pair
    else:
        wp.atomic_or(w.count, FAILURE, _TOO_MANY)
