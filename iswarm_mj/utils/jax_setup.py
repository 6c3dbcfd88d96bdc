"""Compiled programs that outlast the process."""

import os
import platform
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


def quieten() -> None:
    """Keep XLA's log from the terminal; to be called before JAX is imported.

    Each program that JAX 0.10 and 0.11 load from their cache on a CPU is reported as an error, since the list of
    features stored with it names two preferences of the compiler that no processor has. Nothing is wrong.
    """
    os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")


def keep_compiled_programs() -> None:
    """Let JAX keep what it compiles, for this machine, in the user's cache directory.

    The environment's JAX_COMPILATION_CACHE_DIR goes first, then XDG_CACHE_HOME, then ~/.cache.
    """
    import jax

    if not os.environ.get("JAX_COMPILATION_CACHE_DIR"):
        cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
        jax.config.update("jax_compilation_cache_dir", str(cache / "iswarm_mj" / f"jax-{platform.node()}"))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)


@contextmanager
def without_shardy() -> Iterator[None]:
    """Have programs for several devices partitioned by GSPMD.

    The other partitioner, Shardy, dies with a segmentation fault in JAX 0.11.2 where it removes unused inputs of a
    `shard_map` of MJX's step. No program of ours leaves anything to a partitioner.
    """
    import jax

    name = "jax_use_shardy_partitioner"
    before = getattr(jax.config, name, None)
    if not before:
        yield
        return
    jax.config.update(name, False)
    try:
        yield
    finally:
        jax.config.update(name, before)
