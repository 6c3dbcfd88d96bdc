"""Speed of the gripper's bench on this machine, in physics steps per second."""

import json
import time
from typing import Any

import mujoco
import numpy as np
from mujoco.batch import Batch

from iswarm_mj.engines.mujoco.timers import without_timers
from iswarm_mj.gripper.bench.model import bench_spec, layout, sized
from iswarm_mj.gripper.bench.protocol import Protocol
from iswarm_mj.gripper.bench.ramps import release
from iswarm_mj.gripper.bench.run_trials import EngineChoice, bench_maker
from iswarm_mj.gripper.bench.staircase import hang, staircase
from iswarm_mj.gripper.bench.trial import draw
from iswarm_mj.gripper.laws.detachment import RELEASE_GAP
from iswarm_mj.utils.profiling import hardware

BENCHES, STEPS, LAPS = 64, 500, 9
"""Benches in the batch of one thread, physics steps in a lap, and laps after the warm-up."""

SITUATIONS = {"flight": (30.0, 30.0), "plate": (-2e-4, 5.0), "plate_and_tool": (-2e-4, -0.02)}
"""Gaps of ball to plate and tool to ball at the start of a lap [um]; in the last two the ball stays there."""

_VOLTAGE = 20.0
"""Of the tool while a situation is timed [V]."""


def speed(engine: str, impl: str, n_trials: int, seed: int) -> dict[str, Any]:
    """Time whole trials, grasp and release, after a warm-up; print one JSON line and return its content.

    The C engine, on one thread, is also timed with the ball in free flight, on the plate, and between plate and tool.
    """
    content: dict[str, Any] = {"what": "grasp", "engine": engine}
    if engine == "mujoco":
        rates = {name: _situation(*gaps) for name, gaps in SITUATIONS.items()}
        content |= {f"steps_per_s_{name}": round(rate) for name, rate in rates.items()}
        content |= {"threads": 1} | _trials(EngineChoice(threads=1), n_trials, seed, laps=5)
    else:
        import jax

        device = jax.devices()[0]
        content |= {"impl": impl, "device": f"{device.platform}: {device.device_kind}"}
        content |= _trials(EngineChoice(engine, impl), n_trials, seed, laps=1)
    content |= hardware()
    print(json.dumps(content))
    return content


def _situation(gap_plate: float, gap_tool: float) -> float:
    """Steps per second of one thread, the median of the laps, each of which starts at these gaps [um]."""
    model = sized(bench_spec(), draw(0, 20e-6, 10.0, 0))
    where, radius = layout(model), float(model.geom("ball").size[0])
    batch = Batch(model, BENCHES, 1)
    qpos, ctrl = batch.bind("qpos"), batch.bind("ctrl")
    laps = []
    for _ in range(LAPS + 1):
        batch.reset(stage=mujoco.mjtStage.mjSTAGE_NONE)
        qpos[:, where.ball + 2] = gap_plate + radius
        qpos[:, where.slide] = gap_plate + 2 * radius + gap_tool - where.tip_height
        ctrl[:, where.tip], ctrl[:, where.voltage] = qpos[:, where.slide], _VOLTAGE
        started = time.perf_counter()
        with without_timers():
            batch.step(nstep=STEPS)
        laps.append(time.perf_counter() - started)
    return BENCHES * STEPS / float(np.median(laps[1:]))


def _trials(engine: EngineChoice, n_trials: int, seed: int, laps: int) -> dict[str, Any]:
    """Time of whole trials: set-up, staircase of grasps, release."""
    make, protocol = bench_maker(engine), Protocol()
    trials = [draw(seed, radius, 10.0, i) for i, radius in enumerate(np.linspace(15e-6, 25e-6, n_trials))]
    times, steps, voltage = [], 0, np.array([])
    started = time.perf_counter()
    make(trials, protocol.start_gap).move("warm-up", 0.01e-3, 0.0, 0.0)
    warm_up = time.perf_counter() - started
    for _ in range(laps):
        started = time.perf_counter()
        bench = make(trials, protocol.start_gap)
        grasp = staircase(bench, protocol, n_trials)
        held = np.isfinite(grasp.voltage)
        hang(bench, protocol, RELEASE_GAP, held)
        voltage = release(bench, protocol, held, RELEASE_GAP).voltage
        times.append(time.perf_counter() - started)
        steps = bench.steps
    seconds = float(np.median(times))
    return {
        "trials": n_trials,
        "steps": steps,
        "seconds": round(seconds, 3),
        "warm_up_seconds": round(warm_up, 3),
        "steps_per_s_trials": round(steps / seconds),
        "released": int(np.isfinite(voltage).sum()),
    }
