"""Closed-form fast-forwards of a trial on a bench of one ball (`leap_laws`).

They are two thirds of a trial: the tool presses the ball on the plate, and only where it is now matters; a ball hangs
at rest while charge flows; an uncharged ball flies. Whatever makes or ends a contact is left to physics.
"""

from typing import TYPE_CHECKING, NamedTuple

import mujoco
import numpy as np

from iswarm_mj.gripper.bench.leap_laws import REST, Hanging, after_hanging, flight_time, hanging_time
from iswarm_mj.gripper.units import CLEARANCE, MS

if TYPE_CHECKING:
    from iswarm_mj.gripper.bench.engine_mujoco import MujocoBench

UNCHARGED = 1e-3
"""Part of its weight with which the field may pull a ball that flies freely."""


class Row(NamedTuple):
    """State of a bench with one ball, in arrays that may be written; see MuJoCo."""

    qpos: np.ndarray
    qvel: np.ndarray
    plugin_state: np.ndarray
    qacc_warmstart: np.ndarray


def is_below(bench: "MujocoBench") -> bool:
    """Whether the ball at rest is below the tool's flat face, not below or beside its edge."""
    return abs(float(bench.row.qpos[bench.where.aside])) < float(bench.model.geom("probe").size[0])


def press(bench: "MujocoBench", control: np.ndarray) -> None:
    """Put the tool where it presses the ball on the plate.

    There the ball has the plate's potential and cannot move, so that after a few steps nothing is left of what was
    before: contacts and servos alone hold it.

    Args:
        bench: of one ball.
        control: setpoints (nu,), the tip's below its first touch of the ball.
    """
    model, row, where = bench.model, bench.row, bench.where
    radius = float(model.geom("ball").size[0])
    depth = 2 * radius - (control[where.tip] + where.tip_height)
    row.qpos[:], row.qvel[:] = model.qpos0, 0.0
    row.qpos[where.slide], row.qpos[where.aside] = control[where.tip], control[where.aside_servo]
    row.qpos[where.ball + 2] = radius - depth / 2
    _sync_contacts(bench)


def hang(bench: "MujocoBench", phase: str, voltage: float, limit: float) -> float:
    """Let charge flow while the ball hangs at rest; the depth of the contact follows the force that holds it.

    Args:
        bench: of one ball.
        phase: name of the phase, for recordings.
        voltage: of the tool, constant [V].
        limit: at most so long [s].

    Returns:
        Time that passed [s]; 0 unless the ball hangs at rest with a voltage between 0 and the tool's.
    """
    row, ball = bench.row, bench.where.ball
    above, below = _gaps(bench)
    if above > 0 or below < CLEARANCE or float(np.abs(row.qvel[ball : ball + 3]).max()) >= REST:
        return 0.0
    names = ("ball_voltage", "charge", "to_probe", "to_plate", "leak", "up", "down")
    numbers = (bench.number("electrostatic", name) for name in names)
    tool, plate = (bench.number(surface, "force") for surface in ("adhesion_probe", "adhesion_plate"))
    hanging = Hanging(voltage, *numbers, adhesion=tool, hold=tool - plate - _weight(bench))
    time = hanging_time(hanging, limit / MS, 1.0)
    if time <= 0:
        return 0.0
    steps = int(time * MS / bench.timestep)
    charge, share = after_hanging(hanging, steps * bench.timestep / MS)
    row = Row(*(values.copy() for values in row))
    row.qpos[ball + 2] += above * (1 - share)
    row.qvel[:], row.plugin_state[bench.at["electrostatic", "charge"]] = 0.0, charge
    return _leap(bench, phase, steps, row)


def fly(bench: "MujocoBench", phase: str, limit: float) -> float:
    """Let an uncharged ball fly on its parabola until it is near the plate or the tool.

    Nearer than `CLEARANCE` the surfaces pull it; what they do to it farther off is less than a thousandth of its energy
    at 1 mm/s.

    Args:
        bench: of one ball.
        phase: name of the phase, for recordings.
        limit: at most so long [s].

    Returns:
        Time that passed [s]; 0 if the ball is charged or near a surface.
    """
    gravity, ball = -float(bench.model.opt.gravity[2]), bench.where.ball
    above, below = (gap - CLEARANCE for gap in _gaps(bench))
    field = max(bench.number("electrostatic", name) for name in ("up", "down"))
    if min(above, below) <= 0 or field > UNCHARGED * _weight(bench) or bench.number("electrostatic", "charge") != 0:
        return 0.0
    row = Row(*(values.copy() for values in bench.row))
    steps = int(min(flight_time(float(row.qvel[ball + 2]), above, below, gravity) * MS, limit) / bench.timestep)
    time = steps * bench.timestep / MS
    row.qpos[ball : ball + 3] += time * row.qvel[ball : ball + 3]
    row.qpos[ball + 2] -= gravity * time**2 / 2
    row.qvel[ball + 2] -= gravity * time
    mujoco.mju_quatIntegrate(row.qpos[ball + 3 : ball + 7], row.qvel[ball + 3 : ball + 6], time)
    return _leap(bench, phase, steps, row)


def _leap(bench: "MujocoBench", phase: str, steps: int, row: Row) -> float:
    """Resume from this row after some steps; returns their time [s]."""
    bench.elapse([phase] * steps)
    for mine, new in zip(bench.row, row, strict=True):
        mine[:] = new
    _sync_contacts(bench)
    return steps * bench.timestep


def _weight(bench: "MujocoBench") -> float:
    return -float(bench.model.body("ball").mass[0] * bench.model.opt.gravity[2])


def _gaps(bench: "MujocoBench") -> tuple[float, float]:
    """Gaps between the tool's face and a ball below it, and between ball and plate [um]."""
    row, where, radius = bench.row, bench.where, float(bench.model.geom("ball").size[0])
    height = float(row.qpos[where.ball + 2])
    return float(row.qpos[where.slide]) + where.tip_height - height - radius, height - radius


def _sync_contacts(bench: "MujocoBench") -> None:
    """Give the plugins the present gaps, so that they take no leap for an impact, and restart the solver."""
    for surface, gap in zip(("adhesion_probe", "adhesion_plate"), _gaps(bench), strict=True):
        bench.row.plugin_state[bench.at[surface, "before"]] = gap
        bench.row.plugin_state[bench.at[surface, "rebound"]] = 0.0
    bench.row.qacc_warmstart[:] = 0.0
