"""Settings of all tests: types are checked, programs compile fast, and most share a small arena.

JAX compiles once for each configuration and number of robots.
"""

import gc
import os
import sys
from importlib.metadata import version

import psutil
import pytest
from jaxtyping import install_import_hook
from support.types import begin_test

import iswarm_mj  # sets the level of XLA's log, before anything imports JAX

CHECKED = [
    f"{iswarm_mj.__name__}.{module}"
    for module in (
        "geometry.directions",
        "sensors.memory",
        "sensors.messages",
        "sensors.floor",
        "sensors.optics",
        "sensors.links",
        "sensors.channel",
        "strategy.avoidance",
        "strategy.vectors",
        "strategy.controller",
        "strategy.vector_strategy",
        "engines.base",
        "engines.mjx.engine",
        "engines.mjx.sight",
        "engines.mujoco.engine",
        "engines.mujoco.sight",
        "engines.planar.batch_engine",
        "engines.planar.engine",
        "simulation.decide",
        "simulation.layout_checks",
        "simulation.layouts",
        "simulation.build",
        "simulation.step",
        "simulation.worlds",
        "tasks.aggregation",
        "tasks.cleaning",
        "tasks.foraging",
        "tasks.layout",
        "gripper.laws.detachment",
        "gripper.laws.probe_table",
        "gripper.handling",
        "gripper.bench.protocol",
        "gripper.bench.run_trials",
        "paper.analysis.evolution",
        "paper.analysis.judge",
        "paper.analysis.measures",
        "paper.analysis.statistics",
        "output.frames",
        "output.plot_swarm",
        "output.rerun_entities",
        "output.rerun_swarm",
        "output.rerun_trial",
    )
]
"""Modules whose annotations, shapes included, are checked at calls; none that numba compiles."""
install_import_hook(CHECKED, "support.types.check")

from hypothesis import settings
from support import draws
from support.small import SMALL
from support.systems import NOT_ON_WINDOWS

from iswarm_mj.utils.jax_setup import configure_jax

configure_jax()
draws.use_loops()
gc.freeze()
gc.set_threshold(50_000, 20, 20)  # as `iswarm` does
settings.register_profile("repeatable", derandomize=True)  # the same examples each time
settings.load_profile("repeatable")


collect_ignore = []
if sys.platform == "win32":
    collect_ignore += NOT_ON_WINDOWS


FAST_COMPILATION = [
    "--xla_backend_optimization_level=0",
    "--xla_cpu_parallel_codegen_split_count=1",
]
"""Flags of XLA with which programs compile in half the time, and run slower."""
if version("jaxlib") < "0.11":
    # Later versions end the process when they are given a flag that they do not know.
    FAST_COMPILATION.append("--xla_cpu_use_fusion_emitters=false")


def pytest_configure(config):
    """Let programs compile fast, except in slow tests, which run what users run."""
    if config.option.markexpr == "not slow":
        os.environ.setdefault("XLA_FLAGS", " ".join(FAST_COMPILATION))


MAX_MEMORY = max(1.5e9, psutil.virtual_memory().total / 8)
"""Memory of a process above which it forgets the programs that JAX compiled [bytes]."""
REGROWTH = 0.5e9
"""Growth of the memory after which the process forgets programs again [bytes].

The system gets little memory back when programs go."""
memory_limit = MAX_MEMORY


@pytest.fixture(scope="module", autouse=True)
def _forget_programs():
    """Forget compiled programs after a file of tests, once they take gigabytes."""
    import jax

    global memory_limit
    yield
    if psutil.Process().memory_info().rss > memory_limit:
        jax.clear_caches()
        gc.collect()
        memory_limit = max(MAX_MEMORY, psutil.Process().memory_info().rss + REGROWTH)


@pytest.fixture(autouse=True)
def _check_types_again():
    begin_test()


@pytest.fixture(scope="session")
def small():
    """An arena of 15 x 15 rd, with a dump of 3 x 3 rd and 24 balls in two areas of 3 x 3 rd."""
    return SMALL


@pytest.fixture
def few_pixels(monkeypatch):
    """Figures of few pixels; their SVG files, which take as long again, are empty."""
    from matplotlib.figure import Figure

    savefig = Figure.savefig

    def save(drawing, path, format, metadata):
        if format == "png":
            savefig(drawing, path, format=format, metadata=metadata, dpi=20)
        else:
            path.touch()

    monkeypatch.setattr(Figure, "savefig", save)
