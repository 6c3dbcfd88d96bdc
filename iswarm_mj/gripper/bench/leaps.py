"""Times of a trial that need no physics steps: what happens in them is known, so that a bench leaps to their end.

They are two thirds of a trial: the tool presses the ball on the plate, and only where it is now matters; a ball hangs
at rest while charge flows, by an exponential law; an uncharged ball flies, by a parabola. Whatever makes or ends a
contact is left to physics.
"""

import math
from typing import Any, NamedTuple, Protocol

import mujoco
import numpy as np

from iswarm_mj.gripper import plugin
from iswarm_mj.gripper.bench.model import Layout, layout
from iswarm_mj.gripper.units import CLEARANCE, MS

MARGIN = 0.03
"""Part of the tool's adhesion by which a ball must be held while a leap lasts: with less it is about to leave."""
REST = 0.2
"""Speed up to which a ball that touches the tool counts as resting [um/ms]."""
UNCHARGED = 1e-3
"""Part of its weight with which the field may pull a ball that flies freely."""


class Row(NamedTuple):
    """State of a bench with one ball, in arrays that may be written; see MuJoCo."""

    qpos: np.ndarray
    qvel: np.ndarray
    plugin_state: np.ndarray
    qacc_warmstart: np.ndarray


class Places(NamedTuple):
    """Where numbers are in a model and in a row; of the plugin's results see `plugin.COMPUTED`."""

    layout: Layout
    geom: int
    """The ball."""
    body: int
    """The ball."""
    leak: int
    charge: int
    to_probe: int
    to_plate: int
    ball_voltage: int
    up: int
    down: int
    force: tuple[int, int]
    """Adhesion of tool and plate."""
    before: tuple[int, int]
    """Gaps to tool and plate."""
    rebound: tuple[int, int]
    """From tool and plate."""


def places(model: mujoco.MjModel) -> Places:
    """Places in a bench's model."""

    def at(instance: str, *names: str) -> list[int]:
        return [plugin.state_index(model, instance, name) for name in names]

    names = ("leak", "charge", "to_probe", "to_plate", "ball_voltage", "up", "down")
    numbers: dict[str, Any] = dict(zip(names, at("electrostatic", *names), strict=True))
    names = ("force", "before", "rebound")
    both = (at(surface, *names) for surface in ("adhesion_probe", "adhesion_plate"))
    numbers |= dict(zip(names, zip(*both, strict=True), strict=True))
    return Places(layout(model), model.geom("ball").id, model.body("ball").id, **numbers)


class LeapBench(Protocol):
    """A bench with one ball whose state can be read and written.

    Attributes:
        timestep: [s].
        model: with the ball that lies on it.
        places: of numbers in `model` and `row`.
        row: its state; what is written there is the state from which physics goes on.
    """

    timestep: float
    model: mujoco.MjModel
    places: Places
    row: Row

    def elapse(self, phase: str, steps: int) -> None:
        """Let the time of some steps pass with tool and voltage as they are; the row is written anew afterwards."""
        ...


def is_below(bench: LeapBench) -> bool:
    """Whether the ball at rest is below the tool's flat face, not below or beside its edge."""
    where = bench.places.layout
    return abs(float(bench.row.qpos[where.aside])) < float(bench.model.geom("probe").size[0])


def press(bench: LeapBench, control: np.ndarray) -> None:
    """Put the tool where it presses the ball on the plate.

    There the ball has the plate's potential and cannot move, so that after a few steps nothing is left of what was
    before: contacts and servos alone hold it.

    Args:
        bench: of one ball.
        control: setpoints (nu,), the tip's below its first touch of the ball.
    """
    model, row, (where, geom, *_) = bench.model, bench.row, bench.places
    radius = float(model.geom_size[geom, 0])
    depth = 2 * radius - (control[where.tip] + where.tip_height)
    row.qpos[:], row.qvel[:] = model.qpos0, 0.0
    row.qpos[where.slide], row.qpos[where.aside] = control[where.tip], control[where.aside_servo]
    row.qpos[where.ball + 2] = radius - depth / 2
    _meet(bench)


def hang(bench: LeapBench, phase: str, voltage: float, limit: float) -> float:
    """Let charge flow while the ball hangs at rest, until it is held with no more than `MARGIN`.

    Its voltage follows that of the tool, u' = (V - u) / T, T = (C_t + C_p) R, and with it the balance of the forces,
    adhesion + a (V - u)^2 - b u^2 - weight, falls; the depth of the contact follows this balance.

    Args:
        bench: of one ball.
        phase: name of the phase, for recordings.
        voltage: of the tool, constant [V].
        limit: at most so long [s].

    Returns:
        Time that passed [s]; 0 unless the ball hangs at rest with a voltage between 0 and the tool's.
    """
    row, at = bench.row, bench.places
    state, where = row.plugin_state, at.layout
    above, below = _gaps(bench)
    is_still = float(np.abs(row.qvel[where.ball : where.ball + 3]).max()) < REST
    leak, to_probe, to_plate, was = (float(state[k]) for k in (at.leak, at.to_probe, at.to_plate, at.ball_voltage))
    if above > 0 or below < CLEARANCE or not is_still or leak <= 0 or not 0 < was < voltage:
        return 0.0
    total = to_probe + to_plate
    start = (float(state[at.charge]) + to_probe * voltage) / total
    up, down = float(state[at.up]) / (voltage - was) ** 2, float(state[at.down]) / was**2
    tool, plate = (float(state[k]) for k in at.force)
    still = tool - plate - _weight(bench)

    def pull(volts: float) -> float:
        return still + up * (voltage - volts) ** 2 - down * volts**2

    if pull(start) <= MARGIN * tool or not 0 < start < voltage:
        return 0.0
    time, relaxation = limit / MS, leak * total
    if pull(voltage) <= MARGIN * tool:
        square = up * voltage**2 + still - MARGIN * tool
        end = square / (up * voltage + math.sqrt((up * voltage) ** 2 - (up - down) * square))
        time = min(time, relaxation * math.log((voltage - start) / (voltage - end)))
    steps = int(time * MS / bench.timestep)
    volts = voltage + (start - voltage) * math.exp(-steps * bench.timestep / MS / relaxation)
    row = Row(*(values.copy() for values in row))
    row.qpos[where.ball + 2] += above * (1 - pull(volts) / pull(start))
    row.qvel[:], row.plugin_state[at.charge] = 0.0, to_plate * volts - to_probe * (voltage - volts)
    return _leap(bench, phase, steps, row)


def fly(bench: LeapBench, phase: str, limit: float) -> float:
    """Let an uncharged ball fly between plate and tool until it is about to touch one of them.

    Nearer than `CLEARANCE` the surfaces pull it; what they do to it farther off is less than a thousandth of its energy
    at 1 mm/s.

    Args:
        bench: of one ball.
        phase: name of the phase, for recordings.
        limit: at most so long [s].

    Returns:
        Time that passed [s]; 0 if the ball is charged or near a surface.
    """
    at, gravity = bench.places, -float(bench.model.opt.gravity[2])
    above, below = (gap - CLEARANCE for gap in _gaps(bench))
    field = max(float(bench.row.plugin_state[k]) for k in (at.up, at.down))
    if min(above, below) <= 0 or field > UNCHARGED * _weight(bench) or bench.row.plugin_state[at.charge] != 0:
        return 0.0
    row, ball = Row(*(values.copy() for values in bench.row)), at.layout.ball
    rise = float(row.qvel[ball + 2])
    time = (rise + math.sqrt(rise**2 + 2 * gravity * below)) / gravity
    if rise > 0 and rise**2 > 2 * gravity * above:
        time = 2 * above / (rise + math.sqrt(rise**2 - 2 * gravity * above))
    steps = int(min(time * MS, limit) / bench.timestep)
    time = steps * bench.timestep / MS
    row.qpos[ball : ball + 3] += time * row.qvel[ball : ball + 3]
    row.qpos[ball + 2] -= gravity * time**2 / 2
    row.qvel[ball + 2] -= gravity * time
    mujoco.mju_quatIntegrate(row.qpos[ball + 3 : ball + 7], row.qvel[ball + 3 : ball + 6], time)
    return _leap(bench, phase, steps, row)


def _leap(bench: LeapBench, phase: str, steps: int, row: Row) -> float:
    """Go on from this row, some steps later; returns their time [s]."""
    bench.elapse(phase, steps)
    for mine, new in zip(bench.row, row, strict=True):
        mine[:] = new
    _meet(bench)
    return steps * bench.timestep


def _weight(bench: LeapBench) -> float:
    return -float(bench.model.body_mass[bench.places.body] * bench.model.opt.gravity[2])


def _gaps(bench: LeapBench) -> tuple[float, float]:
    """Gaps between the tool's face and a ball below it, and between ball and plate [um]."""
    row, where, radius = bench.row, bench.places.layout, float(bench.model.geom_size[bench.places.geom, 0])
    height = float(row.qpos[where.ball + 2])
    return float(row.qpos[where.slide]) + where.tip_height - height - radius, height - radius


def _meet(bench: LeapBench) -> None:
    """Tell the plugins where the ball is, so that they take no leap for an impact; the solver starts anew."""
    row, at = bench.row, bench.places
    row.plugin_state[list(at.before)] = _gaps(bench)
    row.plugin_state[list(at.rebound)] = 0.0
    row.qacc_warmstart[:] = 0.0
