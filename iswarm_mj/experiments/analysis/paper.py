"""Numbers of the paper's section 4.6 that statements compare with."""

import math

STEPS = 800
"""Control steps of a run of the evolution."""
SHORTEST = 250
"""Control steps that section 4.6 takes, about, for the theoretical shortest finishing time."""
PAPER_FITNESS = {"type1": 7771, "type2": 7766}
"""Of the fittest swarm of each type in Table 2, which is the best of the runs of the evolution."""
NEARLY = 0.05
"""Fitness within this share of the paper's is the same: 39 steps of the finishing time."""


def latest_finish(fitness: float, n_dust: int = 72) -> int:
    """Control step at which a swarm with so many points had delivered all balls at the latest.

    By section 4.6 a ball delivered gives 40 points and each of 800 steps left 10, and collisions take some away: 7771 =
    2880 + 10 (800 - t) - c leaves t = 310 with c = 9, which is 180 collisions a robot, or an earlier step with 10
    points more lost by collisions; 7766 leaves t = 311 with c = 4, 80 collisions a robot. From 250 steps the formula
    makes 2880 + 5500 = 8380 points; the paper's 8360 are 548 steps left instead of 550.

    Args:
        fitness: more than 40 `n_dust` points.
        n_dust: balls in the arena.
    """
    return math.floor(STEPS - (fitness - 40 * n_dust) / 10)


PAPER_TIME = {name: latest_finish(points) for name, points in PAPER_FITNESS.items()}
"""Finishing times of the paper's types [steps]."""

BEST = (0.1, 0.15)
"""Between these densities the paper found the best swarms."""
CLEAN = (0.1, 0.2)
"""Between these densities they cleaned the arena."""
SPARSEST = 0.05
"""The smallest density that it tried."""
