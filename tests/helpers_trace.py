"""A real trial of the bench: grasp at 40 V, then release by a ramp at a gap of 5 um; about 6 ms in 6000 steps."""

from functools import cache
from pathlib import Path

import mujoco
import numpy as np

import iswarm_mj.gripper.plugin as plugin
from iswarm_mj.gripper.bench.trial_trace import Trace

BENCH = Path(__file__).parents[1] / "models" / "bench.xml"
SCRIPT = (
    # phase, duration [ms], height of the probe and voltage at its end
    ("approach", 0.5, -5.005, 0.0),
    ("ramp", 1.0, -5.005, 40.0),
    ("retract", 1.0, 0.0, 40.0),
    ("voltage off", 0.3, 0.0, 0.0),
    ("release ramp", 2.5, 0.0, 50.0),
    ("rest", 0.7, 0.0, 0.0),
)
RADIUS, PROBE_RADIUS = 20e-6, 13e-6


def normal_force(model, data, geom):
    """Of the ball's contact with a geom [nN]."""
    wrench, force = np.zeros(6), 0.0
    for i in range(data.ncon):
        if geom in data.contact[i].geom:
            mujoco.mj_contactForce(model, data, i, wrench)
            force += wrench[0]
    return force


@cache
def bench_trace() -> Trace:
    """Every third step of the script on the bench with its own constants."""
    model = mujoco.MjModel.from_xml_path(str(BENCH))
    data = mujoco.MjData(model)
    plate, probe = model.geom("plate").id, model.geom("probe").id
    names = (("electrostatic", "probe_gap"), ("electrostatic", "plate_gap"), ("adhesion_probe", "force"))
    names += (("adhesion_plate", "force"), ("electrostatic", "force"), ("electrostatic", "potential"))
    at = [plugin.state_index(model, *name) for name in names]
    height, voltage, rows = 0.0, 0.0, []
    for phase, (_, duration, to_height, to_voltage) in enumerate(SCRIPT):
        n = round(duration / model.opt.timestep)
        heights, voltages = np.linspace(height, to_height, n + 1)[1:], np.linspace(voltage, to_voltage, n + 1)[1:]
        height, voltage = to_height, to_voltage
        for i in range(n):
            data.actuator("probe_z").ctrl = heights[i]
            data.actuator("voltage").ctrl = voltages[i]
            mujoco.mj_step(model, data)
            if i % 3 == 0:
                contacts = normal_force(model, data, probe), normal_force(model, data, plate)
                pose = *data.body("probe").xpos, *data.joint("ball").qpos
                rows.append((data.time, phase, voltages[i], *pose, *data.plugin_state[at], *contacts))
    table = np.array(rows)
    force = table[:, 15:18] * 1e-9
    return Trace(
        time=table[:, 0] * 1e-3,
        phase=table[:, 1].astype(int),
        phases=tuple(name for name, *_ in SCRIPT),
        voltage=table[:, 2],
        probe=table[:, 3:6] * 1e-6,
        ball=table[:, 6:9] * 1e-6,
        ball_quaternion=table[:, 9:13],
        gap_tool=table[:, 13] * 1e-6,
        gap_plate=table[:, 14] * 1e-6,
        adhesion_tool=force[:, 0],
        adhesion_plate=force[:, 1],
        electrostatic=force[:, 2],
        on_plate_potential=table[:, 18] < 0.5,
        ball_voltage=np.where(table[:, 18] < 0.5, 0.0, table[:, 2]),
        contact_tool=table[:, 19] * 1e-9,
        contact_plate=table[:, 20] * 1e-9,
        broken=np.zeros(len(table), bool),
        drive=np.zeros(len(table)),
        impact_loss=np.zeros(len(table)),
        radius=RADIUS,
        probe_radius=PROBE_RADIUS,
        weight=model.body("ball").mass[0] * 9.81 * 1e-9,
        probe_weight=model.body("probe").mass[0] * 9.81 * 1e-9,
    )
