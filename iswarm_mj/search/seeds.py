"""Seeds of runs, by their places in a search or an experiment."""

import numpy as np


def run_seed(seed: int, *place: int) -> int:
    """Seed of one run of an experiment, within 0 to 2^32 - 2; different places give independent
    seeds."""
    state = np.random.SeedSequence(seed, spawn_key=place).generate_state(1, np.uint64)
    return int(state[0] % (2**32 - 1))
