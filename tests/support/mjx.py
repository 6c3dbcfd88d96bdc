"""Small worlds in compiled engines, and what is compiled for them: tests that agree in all of this
share one program.

A program depends on the configuration, the number of robots, the worlds of a device, the number of
recorded worlds and the steps of a chunk, which are ten in `ENGINES`.
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
N, WORLDS, RECORDED, SEED = 24, 3, (2, 0), 5


def tiny_run(engine, record_worlds=RECORDED, capacity=None, **fields):
    """Return a run of three tiny worlds, with other fields of their scenario."""
    usual = {"robots": N, "steps": 20, "seed": SEED, "worlds": WORLDS}
    scenario = Scenario(TINY, engine=engine, **usual | fields)
    return Run(scenario, record_worlds=record_worlds, capacity=capacity)


def mjx(**own):
    return MjxSettings(**{"devices": tuple(jax.devices("cpu")[:1]), **own})


def warp(**own):
    return PlanarSettings(
        **{"impl": "warp", "chunk": 10, "devices": tuple(jax.devices("cpu")[:1]), **own}
    )


ENGINES = {"mjx": mjx(chunk=10), "warp": warp()}


def ran(run):
    """All records of a run (T, W, ...), None if there are none."""
    records = []
    while not run.is_over:
        records.append(run.advance())
    return None if records[0] is None else jax.tree.map(lambda *a: np.concatenate(a), *records)


def poses(run):
    """Poses (B, N, 3) of the worlds."""
    return np.asarray(run.arrays()[1].bodies.poses)


@contextmanager
def compilations():
    """List of the names of the programs that are compiled, or read from the cache, within the
    block."""
    names = []

    class Listener(logging.Handler):
        def emit(self, record):
            message = record.getMessage()
            if message.startswith("Finished XLA compilation of "):
                names.append(message.split()[4])

    listener, logger = Listener(), logging.getLogger("jax")
    logger.addHandler(listener)
    try:
        with jax.log_compiles(True):
            yield names
    finally:
        logger.removeHandler(listener)
