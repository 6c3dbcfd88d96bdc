"""A bench of one ball in MuJoCo's C engine: physics step by step, and closed-form leaps over times (`leap_laws`).

Leaps are two thirds of a trial: the tool presses the ball on the plate, and only where it is now matters; a ball hangs
at rest while charge flows; an uncharged ball flies. Whatever makes or ends a contact is left to physics.
"""

import copy
from collections.abc import Sequence

import mujoco
import numpy as np

from iswarm_mj.engines.mujoco_warnings import keep_no_log
from iswarm_mj.gripper import plugin
from iswarm_mj.gripper.bench.base import Move
from iswarm_mj.gripper.bench.leap_laws import REST, Hanging, after_hanging, flight_time, hanging_time
from iswarm_mj.gripper.bench.model import STATE, Recorded, layout, plugin_numbers, resized, shares, start, usual_model
from iswarm_mj.gripper.bench.trial import Trial
from iswarm_mj.gripper.laws.detachment import PROBE_RADIUS
from iswarm_mj.gripper.units import CLEARANCE, MS, UM

UNCHARGED = 1e-3
"""Part of its weight with which the field may pull a ball that flies freely."""


class SingleBench:
    """A ball and a tool of the usual radius.

    Attributes:
        model: with the ball's radius.
        data: of MuJoCo; physics resumes from what is written there.
        where: numbers are in its arrays.
        at: indices of the plugins' numbers in `plugin_state`, by instance and field.
        timestep: [s].
        recorded: all steps since the trial began, where they are kept.
        fall: downward speed of the ball as the last step began [m/s].
    """

    def __init__(self, timestep: float, is_recorded: bool = False):
        """Prepare a bench on which `place` begins a trial."""
        keep_no_log()
        self._usual = usual_model(timestep, PROBE_RADIUS)
        self.model, self.data, self.timestep = copy.copy(self._usual), mujoco.MjData(self._usual), timestep
        self.where, self.at = layout(self.model), plugin.state_indices(self.model)
        self.recorded: list[Recorded] | None = [] if is_recorded else None
        self.fall = self._touch = 0.0

    def place(self, trial: Trial, start_gap: float, hanging: float | None = None) -> None:
        """Begin a trial, see `model.start`; a tenth of the time that a new bench takes."""
        data, where = self.data, self.where
        self.model = resized(self._usual, trial.radius, self.model)
        mujoco.mj_resetData(self.model, data)
        data.qpos[:], self._touch = start(self.model, trial, start_gap, hanging)
        for names, value in plugin_numbers(trial).items():
            data.plugin_state[self.at[names]] = value
        data.ctrl[[where.tip, where.aside_servo]] = data.qpos[[where.slide, where.aside]]

    def way(self, moves: Sequence[Move]) -> list[tuple[str, float, float]]:
        """Phase and setpoints of tip [um] and voltage [V] in each physics step of moves, from the present ones on."""
        samples: list[tuple[str, float, float]] = []
        tip, voltage = self.data.ctrl[[self.where.tip, self.where.voltage]]
        for phase, duration, height, volts in moves:
            share = shares(max(1, round(duration / self.timestep)))
            tips = tip + share[:, 1] * (self._touch + height / UM - self.where.tip_height - tip)
            voltages = voltage + share[:, 0] * (volts - voltage)
            samples += zip([phase] * len(share), tips.tolist(), voltages.tolist(), strict=True)
            tip, voltage = tips[-1], voltages[-1]
        return samples

    def step(self, phase: str, tip: float | None = None, voltage: float | None = None) -> None:
        """Take a physics step, with these setpoints, see `way`, or the present ones."""
        data = self.data
        if tip is not None and voltage is not None:
            data.ctrl[self.where.tip], data.ctrl[self.where.voltage] = tip, voltage
        self.fall = -data.qvel[self.where.ball + 2] * UM / MS
        if self.recorded is None:
            mujoco.mj_step(self.model, data)
            return
        before = self._state()
        mujoco.mj_step(self.model, data)
        self.recorded.append(Recorded([phase], np.stack([before, self._state()])))

    def elapse(self, phase: str, steps: int) -> None:
        """Let time pass without physics; where it is recorded, by physics from which the ball then returns."""
        if self.recorded is None:
            return
        arrays = self.data.qpos, self.data.qvel, self.data.plugin_state
        kept = [values.copy() for values in arrays]
        for _ in range(steps):
            self.step(phase)
        for values, old in zip(arrays, kept, strict=True):
            values[:] = old

    def forget(self, steps: int) -> None:
        """Leave the last steps out of the recording."""
        if self.recorded is not None and steps > 0:
            del self.recorded[-steps:]

    def number(self, instance: str, field: str) -> float:
        """A number of the ball's plugins, see `plugin.state_index`."""
        return float(self.data.plugin_state[self.at[instance, field]])

    @property
    def gap_tool(self) -> float:
        """As the last step began [m]."""
        return self.data.plugin_state[self.at["electrostatic", "probe_gap"]] * UM

    @property
    def gap_plate(self) -> float:
        """As the last step began [m]."""
        return self.data.plugin_state[self.at["electrostatic", "plate_gap"]] * UM

    @property
    def speed(self) -> float:
        """Of the ball as the last step ended [m/s]."""
        x, y, z = self.data.qvel[self.where.ball : self.where.ball + 3].tolist()
        return (x * x + y * y + z * z) ** 0.5 * UM / MS

    @property
    def is_finite(self) -> bool:
        """Whether the state is finite and MuJoCo has warned of nothing."""
        return bool(np.isfinite(self._state()).all() and not self.data.warning.number.any())

    def _state(self) -> np.ndarray:
        state = np.empty(mujoco.mj_stateSize(self.model, STATE))
        mujoco.mj_getState(self.model, self.data, state, STATE)
        return state

    @property
    def is_below(self) -> bool:
        """Whether the ball at rest is below the tool's flat face, not below or beside its edge."""
        return abs(float(self.data.qpos[self.where.aside])) < float(self.model.geom("probe").size[0])

    def press(self, tip: float) -> None:
        """Put the tool where it presses the ball on the plate.

        There the ball has the plate's potential and cannot move, so that after a few steps nothing is left of what was
        before: contacts and servos alone hold it.

        Args:
            tip: setpoint of the tip, below its first touch of the ball [um].
        """
        model, data, where = self.model, self.data, self.where
        radius = float(model.geom("ball").size[0])
        data.qpos[:], data.qvel[:] = model.qpos0, 0.0
        data.qpos[where.slide], data.qpos[where.aside] = tip, data.ctrl[where.aside_servo]
        data.qpos[where.ball + 2] = radius - (2 * radius - (tip + where.tip_height)) / 2
        self._sync_contacts()

    def hang(self, phase: str, voltage: float, limit: float) -> float:
        """Let charge flow while the ball hangs at rest; the depth of the contact follows the force that holds it.

        Args:
            phase: name of the phase, for recordings.
            voltage: of the tool, constant [V].
            limit: at most so long [s].

        Returns:
            Time that passed [s]; 0 unless the ball hangs at rest with a voltage between 0 and the tool's.
        """
        data, ball, (above, below) = self.data, self.where.ball, self._gaps()
        if above > 0 or below < CLEARANCE or float(np.abs(data.qvel[ball : ball + 3]).max()) >= REST:
            return 0.0
        names = ("ball_voltage", "charge", "to_probe", "to_plate", "leak", "up", "down")
        numbers = (self.number("electrostatic", name) for name in names)
        tool, plate = (self.number(surface, "force") for surface in ("adhesion_probe", "adhesion_plate"))
        hanging = Hanging(voltage, *numbers, adhesion=tool, hold=tool - plate - self._weight)
        time = hanging_time(hanging, limit / MS, 1.0)
        if time <= 0:
            return 0.0
        steps = int(time * MS / self.timestep)
        charge, share = after_hanging(hanging, steps * self.timestep / MS)
        self.elapse(phase, steps)
        data.qpos[ball + 2] += above * (1 - share)
        data.qvel[:], data.plugin_state[self.at["electrostatic", "charge"]] = 0.0, charge
        self._sync_contacts()
        return steps * self.timestep

    def fly(self, phase: str, limit: float) -> float:
        """Let an uncharged ball fly on its parabola until it is near the plate or the tool.

        Nearer than `CLEARANCE` the surfaces pull it; farther off they change less than a thousandth of its energy at
        1 mm/s.

        Args:
            phase: name of the phase, for recordings.
            limit: at most so long [s].

        Returns:
            Time that passed [s]; 0 if the ball is charged or near a surface.
        """
        gravity, ball = -float(self.model.opt.gravity[2]), self.where.ball
        above, below = (gap - CLEARANCE for gap in self._gaps())
        field = max(self.number("electrostatic", name) for name in ("up", "down"))
        if min(above, below) <= 0 or field > UNCHARGED * self._weight or self.number("electrostatic", "charge") != 0:
            return 0.0
        qpos, qvel = self.data.qpos, self.data.qvel
        steps = int(min(flight_time(float(qvel[ball + 2]), above, below, gravity) * MS, limit) / self.timestep)
        self.elapse(phase, steps)
        time = steps * self.timestep / MS
        qpos[ball : ball + 3] += time * qvel[ball : ball + 3]
        qpos[ball + 2] -= gravity * time**2 / 2
        qvel[ball + 2] -= gravity * time
        mujoco.mju_quatIntegrate(qpos[ball + 3 : ball + 7], qvel[ball + 3 : ball + 6], time)
        self._sync_contacts()
        return steps * self.timestep

    @property
    def _weight(self) -> float:
        return -float(self.model.body("ball").mass[0] * self.model.opt.gravity[2])

    def _gaps(self) -> tuple[float, float]:
        """Gaps between the tool's face and a ball below it, and between ball and plate [um]."""
        qpos, where, radius = self.data.qpos, self.where, float(self.model.geom("ball").size[0])
        height = float(qpos[where.ball + 2])
        return float(qpos[where.slide]) + where.tip_height - height - radius, height - radius

    def _sync_contacts(self) -> None:
        """Give the plugins the present gaps, so that they take no leap for an impact, and restart the solver."""
        for surface, gap in zip(("adhesion_probe", "adhesion_plate"), self._gaps(), strict=True):
            self.data.plugin_state[self.at[surface, "before"]] = gap
            self.data.plugin_state[self.at[surface, "rebound"]] = 0.0
        self.data.qacc_warmstart[:] = 0.0
