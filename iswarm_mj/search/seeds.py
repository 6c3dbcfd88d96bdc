"""Seeds of runs, by their places in a search or an experiment."""

import numpy as np


def run_seed(seed: int, *place: int) -> int:
    """Return the seed of a run, within 0 to 2^32 - 2.

    Args:
        seed: seed of the search or the experiment.
        place: numbers that say which run it is; different places give independent seeds.
    """
    state = np.random.SeedSequence(seed, spawn_key=place).generate_state(1, np.uint64)
    return int(state[0] % (2**32 - 1))
