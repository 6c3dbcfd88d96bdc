"""A bench of one ball in MuJoCo's C engine: physics step by step, and closed-form leaps over times (`leap_laws`).

Leaps are two thirds of a trial: the tool presses the ball on the plate, and only where it is now matters; a ball hangs
at rest while charge flows; an uncharged ball flies. Whatever makes or ends a contact is left to physics.
"""

import copy
import math

import mujoco
import numpy as np

from iswarm_mj.engines.mujoco_library import keep_no_log
from iswarm_mj.gripper import plugin
from iswarm_mj.gripper.bench.leap_laws import Hanging, leap
from iswarm_mj.gripper.bench.model import layout, plugin_numbers, resized, start, usual_model
from iswarm_mj.gripper.bench.script import Watch
from iswarm_mj.gripper.bench.trial import Trial
from iswarm_mj.gripper.units import MS, UM

_HANGING = "ball_voltage", "charge", "to_probe", "to_plate", "leak", "up", "down"
_TOOL, _PLATE = "adhesion_probe", "adhesion_plate"


class SingleBench:
    """A ball and a tool of the usual radius.

    Attributes:
        model: with the ball's radius.
        data: of MuJoCo; physics resumes from what is written there.
        where: numbers are in its arrays.
        at: indices of the plugins' numbers in `plugin_state`, by instance and field.
        timestep: [s].
    """

    def __init__(self, timestep: float):
        """Prepare a bench on which `place` begins a trial."""
        keep_no_log()
        self._usual = usual_model(timestep)
        self.model, self.data, self.timestep = copy.copy(self._usual), mujoco.MjData(self._usual), timestep
        self.where, self.at = layout(self.model), plugin.state_indices(self.model)
        self._times = [self.at[_TOOL, "last"], self.at[_PLATE, "last"], self.at[_PLATE, "first"]]
        self._gaps = [self.at["electrostatic", name] for name in ("probe_gap", "plate_gap")]
        self._landing = self.at[_PLATE, "landing_speed"]
        self._hanging = [self.at["electrostatic", name] for name in _HANGING]
        self._adhesion = [self.at[surface, "force"] for surface in (_TOOL, _PLATE)]
        self._touch = self._looked = 0.0

    def place(self, trial: Trial, gaps: tuple[float, float]) -> None:
        """Begin a trial with these gaps of the ball to tool and plate [m]; a tenth of the time that a new bench takes.

        If they are negative, the tool presses the ball on the plate. There the ball has the plate's potential and
        cannot move, so that after a few steps nothing is left of what was before.
        """
        data, where = self.data, self.where
        self.model = resized(self._usual, trial.radius, (self.model, data))
        mujoco.mj_resetData(self.model, data)
        data.qpos[:], self._looked = start(self.model, trial, gaps), 0.0
        self._touch = 2 * trial.radius / UM - where.tip_height
        for names, value in plugin_numbers(trial).items():
            data.plugin_state[self.at[names]] = value
        data.ctrl[[where.tip, where.aside_servo]] = data.qpos[[where.slide, where.aside]]

    def step(self, tip: float, voltage: float) -> None:
        """Take a physics step with these setpoints: height of the tool above its first touch [m], and voltage [V]."""
        self.data.ctrl[self.where.tip], self.data.ctrl[self.where.voltage] = self._touch + tip / UM, voltage
        mujoco.mj_step(self.model, self.data)

    def watch(self) -> Watch:
        """What happened since the last look."""
        data, ball = self.data, self.where.ball
        state, (x, y, z) = data.plugin_state.tolist(), data.qvel[ball : ball + 3].tolist()
        last_tool, last_plate, first = (MS * (state[i] - self._looked) for i in self._times)
        gap_tool, gap_plate = (UM * state[i] for i in self._gaps)
        speed = (x * x + y * y + z * z) ** 0.5 * UM / MS
        data.plugin_state[self._times[2]], self._looked = -1.0, data.time
        return Watch(
            last_tool if last_tool >= 0 else -math.inf,
            last_plate if last_plate >= 0 else -math.inf,
            first if first >= 0 else math.inf,
            state[self._landing] * UM / MS,
            gap_tool,
            gap_plate,
            speed,
            math.isfinite(speed),
        )

    @property
    def is_finite(self) -> bool:
        """Whether the state is finite and MuJoCo has warned of nothing."""
        state = np.concatenate([self.data.qpos, self.data.qvel, self.data.plugin_state])
        return bool(np.isfinite(state).all() and not self.data.warning.number.any())

    def leap(self, limits: tuple[float, float], period: float) -> float:
        """Leap over a time in which the ball hangs at rest or flies freely, see `leap_laws.leap`.

        Args:
            limits: longest times of hanging and of flying [s].
            period: of which a leap takes a whole multiple [s].

        Returns:
            Time that passed [s].
        """
        data, model, ball = self.data, self.model, self.where.ball
        state, velocity = data.plugin_state.tolist(), data.qvel[ball : ball + 3].tolist()
        gravity, voltage = -float(model.opt.gravity[2]), float(data.ctrl[self.where.voltage])
        tool, plate = (state[i] for i in self._adhesion)
        hold = tool - plate - gravity * float(model.body_mass[model.dof_bodyid[ball]])
        hanging = Hanging(voltage, *(state[i] for i in self._hanging), adhesion=tool, hold=hold)
        longest = limits[0] / MS, limits[1] / MS
        leapt = leap(hanging, self._present_gaps(), velocity, gravity, longest, period / MS)
        if leapt.hung + leapt.flown == 0:
            return 0.0
        data.qpos[ball : ball + 2] += leapt.flown * data.qvel[ball : ball + 2]
        data.qpos[ball + 2] += leapt.lift
        if leapt.hung > 0:
            data.qvel[:] = 0.0
        data.qvel[ball + 2], data.plugin_state[self.at["electrostatic", "charge"]] = leapt.rise, leapt.charge
        for surface, gap in zip((_TOOL, _PLATE), self._present_gaps(), strict=True):
            data.plugin_state[self.at[surface, "before"]] = gap  # so that they take no leap for an impact
            data.plugin_state[self.at[surface, "rebound"]] = 0.0
        data.qacc_warmstart[:] = 0.0
        return float(leapt.hung + leapt.flown) * MS

    def _present_gaps(self) -> tuple[float, float]:
        """Gaps between the tool's face and a ball below it, and between ball and plate [um]."""
        qpos, where, radius = self.data.qpos, self.where, self._touch + self.where.tip_height
        height = float(qpos[where.ball + 2])
        return float(qpos[where.slide]) + where.tip_height - height - radius / 2, height - radius / 2
