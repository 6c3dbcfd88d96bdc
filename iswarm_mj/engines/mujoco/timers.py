"""MuJoCo's timers, which read the clock some thirty times in a physics step."""

import ctypes
from collections.abc import Iterator
from contextlib import contextmanager

from iswarm_mj.engines.mujoco.library import library


@contextmanager
def without_timers() -> Iterator[None]:
    """Leave `MjData.timer` at zero within the block, in all threads; physics is the same.

    A step of a small model is a third faster. The clock is MuJoCo's global callback `mjcb_time`, which its Python
    bindings install and cannot put back themselves.
    """
    clock = ctypes.c_void_p.in_dll(library(), "mjcb_time")
    kept, clock.value = clock.value, None
    try:
        yield
    finally:
        clock.value = clock.value or kept
