"""Where the time and the memory of a batched control step go, on this machine's devices."""

import json
import time
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from iswarm_mj.engines.mjx.arena import MjxArena, without_absent
from iswarm_mj.engines.mjx.sight import see
from iswarm_mj.simulation import step as swarm
from iswarm_mj.simulation.distributed import ALONE, Hosts, numbered
from iswarm_mj.simulation.run_mjx import BatchRun
from iswarm_mj.simulation.step_mjx import WorldState, drive
from iswarm_mj.simulation.worlds import Given
from iswarm_mj.utils.profiling import processor

REPEATS = 5


def bench(run: BatchRun, n_chunks: int, hosts: Hosts = ALONE) -> dict[str, Any] | None:
    """Time chunks of control steps after the first, print one JSON line and return its content.

    Times are milliseconds per control step of all worlds together: the median over the chunks of the whole, and of
    each stage on its own, of the worlds of one device, from the state at the end. Memory is the most that a device
    had in use until then, in GB. Of several processes, each with a share of the worlds, the slowest counts; the first
    prints and returns, and the stages and the machine are its own.

    Args:
        run: at its start, with enough steps for a chunk of warm-up and `n_chunks` more.
        n_chunks: chunks that are timed.
        hosts: the processes that share the worlds.
    """
    laps = []
    for chunk in range(n_chunks + 1):
        if chunk == 1:
            hosts.gathered("warm", None)
        hosts.look()
        started = time.perf_counter()
        with numbered([world.index for world in run.worlds]):
            run.advance()
        laps.append(time.perf_counter() - started)
    settings, n_robots, devices = run.settings, run.arena.n_robots, list(run.mesh.devices.flat)
    own = (
        len(run.worlds), float(np.median(laps[1:])) / settings.chunk, laps[0], int(run.delivered().sum()),
        _peak_memory(run), len(devices),
    )  # fmt: skip
    n_worlds, step_s, first_s, delivered, memory, n_devices = zip(*hosts.gathered("times", own), strict=True)
    if hosts.index > 0:
        return None
    substeps = run.config.drive.turn_substeps + run.config.drive.walk_substeps
    content = {
        "engine": "mjx",
        "impl": settings.impl,
        "solver_iterations": settings.solver_iterations,
        "n_robots": n_robots,
        "n_worlds": sum(n_worlds),
        "steps": n_chunks * settings.chunk,
        "ms_per_step": round(1e3 * max(step_s), 3),
        "robot_physics_steps_per_s": round(sum(n_worlds) * n_robots * substeps / max(step_s)),
        **{f"{stage}_ms": round(1e3 * t, 3) for stage, t in _stages(run).items()},
        "first_chunk_s": round(max(first_s), 1),
        "delivered_mean": sum(delivered) / sum(n_worlds),
        "peak_memory_gb": max((m for m in memory if m is not None), default=None),
        "devices": f"{sum(n_devices)} x {devices[0].device_kind}",
        "machine": processor(),
    }
    print(json.dumps(content))
    return content


def on_first_device(run: BatchRun) -> tuple[Given, WorldState, MjxArena]:
    """Return what the first device has of what is given and what changes, of worlds of the run alone, and its arena."""
    given, state, arena = jax.tree.map(lambda a: a.addressable_shards[0].data, (*run.arrays(), run.arena))
    given, state = jax.tree.map(lambda a: a[: run.worlds_per_device], (given, state))
    return given, state, arena


def _stages(run: BatchRun) -> dict[str, float]:
    """Seconds per control step of sight, decision and physics, each as a program of its own on the first device."""
    given, state, arena = on_first_device(run)
    config = run.config
    poses, alive = state.bodies.poses, state.swarm.is_alive

    @jax.jit
    @jax.vmap
    def look(poses, alive, present):
        return see(config, arena, poses, alive, present)

    links, walls = look(poses, alive, given.is_present)

    @jax.jit
    @jax.vmap
    def decide(given, state, poses, links, walls):
        return swarm.decide(
            config, arena.probe, given.conditions, given.strategy, state, poses, links, walls, jnp.int32(7), given.key
        )

    command = decide(given, state.swarm, poses, links, walls)[1]

    @jax.jit
    @jax.vmap
    def move(given, bodies, command):
        model = without_absent(arena.model, given.is_present) if run.is_masked else arena.model
        return drive(config, arena, model, bodies, command)

    return {
        "see": _median(look, poses, alive, given.is_present),
        "act": _median(decide, given, state.swarm, poses, links, walls),
        "physics": _median(move, given, state.bodies, command),
    }


def _median(program: Callable[..., Any], *arguments: Any) -> float:
    """Median time of a compiled program [s]."""
    jax.block_until_ready(program(*arguments))
    laps = []
    for _ in range(REPEATS):
        started = time.perf_counter()
        jax.block_until_ready(program(*arguments))
        laps.append(time.perf_counter() - started)
    return float(np.median(laps))


def _peak_memory(run: BatchRun) -> float | None:
    """Most memory that a device had in use [GB]; None where the device does not tell."""
    stats = [device.memory_stats() for device in run.mesh.devices.flat]
    peaks = [s["peak_bytes_in_use"] for s in stats if s and "peak_bytes_in_use" in s]
    return round(max(peaks) / 1e9, 2) if peaks else None
