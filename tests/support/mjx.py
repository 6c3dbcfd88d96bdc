"""Small worlds in compiled engines, and the names of the programs that JAX compiles.

A program depends on the configuration, the number of robots, the worlds of a device, the number of
recorded worlds and the steps of a chunk, which are ten in `ENGINES`. Tests that agree in all of
these share one program.
"""

import logging
from contextlib import contextmanager

import jax
import numpy as np

from iswarm_mj.config.swarm import ArenaConfig, SwarmConfig
from iswarm_mj.engines.mjx.settings import MjxSettings
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.scenario import Scenario

TINY = SwarmConfig(
    arena=ArenaConfig(size=12, dump_size=3, dust_area_size=2, dust_area_offset=4, n_dust=12)
)
N = 24
"""Robots of a tiny world."""
WORLDS = 3
RECORDED = (2, 0)
SEED = 5


def tiny_run(engine, record_worlds=RECORDED, capacity=None, **fields):
    """Return a run of three tiny worlds, with other fields of their scenario."""
    defaults = {"robots": N, "steps": 20, "seed": SEED, "worlds": WORLDS}
    scenario = Scenario(TINY, engine=engine, **defaults | fields)
    return Run(scenario, record_worlds=record_worlds, capacity=capacity)


def mjx(**settings):
    """Return MJX on one device, with further settings."""
    return MjxSettings(**{"devices": tuple(jax.devices("cpu")[:1]), **settings})


def warp(**settings):
    """Return the planar engine for batches on one device, with further settings."""
    one_device = tuple(jax.devices("cpu")[:1])
    return PlanarSettings(**{"impl": "warp", "chunk": 10, "devices": one_device, **settings})


ENGINES = {"mjx": mjx(chunk=10), "warp": warp()}


def ran(run):
    """Return all records of a run (T, W, ...); None if it records no world."""
    records = []
    while not run.is_over:
        records.append(run.advance())
    if records[0] is None:
        return None
    return jax.tree.map(lambda *parts: np.concatenate(parts), *records)


def poses(run):
    """Return the poses (B, N, 3) of the robots of all worlds."""
    return np.asarray(run.arrays()[1].bodies.poses)


@contextmanager
def compilations():
    """Yield a list of the programs that JAX compiles within the block, or reads from the cache."""
    names = []

    class Listener(logging.Handler):
        def emit(self, record):
            message = record.getMessage()
            if message.startswith("Finished XLA compilation of "):
                names.append(message.split()[4])

    listener = Listener()
    logger = logging.getLogger("jax")
    logger.addHandler(listener)
    try:
        with jax.log_compiles(True):
            yield names
    finally:
        logger.removeHandler(listener)
