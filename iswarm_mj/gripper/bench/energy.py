"""The energy of a trial, by its trace: what the electrodes and the tool's drive put in, and where it went."""

from typing import NamedTuple

import numpy as np

from iswarm_mj.gripper.bench.trial import Trial
from iswarm_mj.gripper.bench.trial_trace import Trace
from iswarm_mj.gripper.laws.capacitance import capacitance
from iswarm_mj.gripper.laws.electrostatics import pick_force


class Books(NamedTuple):
    """Energies of a trial, summed over its samples [J]."""

    supply: float
    """Work of the voltage source, V times the charge that it moved."""
    field: float
    """Change of the field's energy, C_t (V - u)^2 / 2 + C_p u^2 / 2."""
    joule: float
    """Heat in the contacts with tool and plate."""
    on_ball: float
    """Work of the field's forces on the ball."""
    on_tool: float
    """Work of the field's forces on the tool."""
    turnover: float
    """Work of the source without its sign: what errors are compared with."""

    @property
    def error(self) -> float:
        """What is missing between the supply's work and its uses, over the turnover."""
        uses = self.field + self.joule + self.on_ball + self.on_tool
        return (self.supply - uses) / self.turnover


def books(trace: Trace, trial: Trial) -> Books:
    """Electrical energy of a trial; the sums go over the physics steps, forces and voltages are means of neighbours.

    Args:
        trace: every physics step of the trial.
        trial: its conduction and its effective gap.
    """
    least = trial.contact_gap
    sizes = trial.radius, trial.probe_radius
    above = capacitance("pick", trace.gap_tool, *sizes, least)
    below = capacitance("release", trace.gap_plate, *sizes, least)
    across, mine = trace.voltage - trace.ball_voltage, trace.ball_voltage
    charge = below * mine - above * across
    leak = np.where(trace.gap_tool <= 0, across / max(trial.contacts.leak, 1e-3), 0.0)
    step = np.diff(trace.time)
    gained = np.diff(charge)
    on_plate = trace.gap_plate[:-1] <= 0
    # What does not flow from the plate flows from the tool.
    from_tool = np.where(on_plate, leak[:-1] * step, np.where(trace.gap_tool[:-1] <= 0, gained, 0.0))
    to_plate = from_tool - gained
    voltage = _middle(trace.voltage)
    moved = np.diff(above * across) + from_tool
    energy = above * across**2 / 2 + below * mine**2 / 2
    up = pick_force(across, np.maximum(trace.gap_tool, least), *sizes)
    ball, tool = np.diff(trace.ball[:, 2]), np.diff(trace.probe[:, 2])
    return Books(
        supply=float((voltage * moved).sum()),
        field=float(energy[-1] - energy[0]),
        joule=float((_middle(across) * from_tool + _middle(mine) * to_plate).sum()),
        on_ball=float((_middle(trace.electrostatic) * ball).sum()),
        on_tool=float((-_middle(np.asarray(up)) * tool).sum()),
        turnover=float(np.abs(voltage * moved).sum()),
    )


def _middle(values: np.ndarray) -> np.ndarray:
    return (values[1:] + values[:-1]) / 2
