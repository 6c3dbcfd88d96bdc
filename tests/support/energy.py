"""Energy balance of a trial from its trace: the work of source, drive and weight, and its uses."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from iswarm_mj.gripper.bench.tracing import Trace
from iswarm_mj.gripper.bench.trial import Trial
from iswarm_mj.gripper.laws import spline
from iswarm_mj.gripper.laws.detachment import GRAVITY
from iswarm_mj.gripper.laws.electrostatics import asymptotic_force, pick_force
from iswarm_mj.gripper.tips.table import read_table
from iswarm_mj.utils.scalar_backends import in_arrays
from support.capacitance import capacitance

Steps = Float[np.ndarray, "T-1"]


class EnergyBalance(NamedTuple):
    """Energies of a trial, summed over its samples; none follows from the balance of others."""

    turnover: float
    """Work of the source without its sign, with which errors are compared [J]."""
    electrical: float
    """Difference between the source's work and its uses, over the turnover."""
    mechanical: float
    """Difference between the work on ball and tool and its uses, over the turnover."""
    parts: dict[str, float]
    """Parts over the turnover.

    `joule` is the heat of contacts, `drive` the work of the drive, `contact` that of contacts,
    and `impact` the loss in impacts.
    """


def energy_balance(trace: Trace, trial: Trial) -> EnergyBalance:
    """Return the energy balance of a trial.

    Sums go over the physics steps; forces and voltages are means of neighbouring samples.

    Args:
        trace: every physics step of the trial.
        trial: its conduction, a circuit, and its effective gap.
    """
    ball_path = np.diff(trace.ball[:, 2])
    tool_path = np.diff(trace.probe[:, 2])
    circuit = _circuit(trace, trial)
    turnover = float(np.abs(circuit.supply).sum())

    # Work of the fields on ball and tool, of the drive and of adhesion.
    across = trace.voltage - trace.ball_voltage
    law_gap = np.maximum(trace.gap_tool, trial.contact_gap)
    pull_of_tool = _pull_of_tool(trial, across, law_gap)
    on_ball = float((_middle(trace.electrostatic) * ball_path).sum())
    on_tool = float((-_middle(pull_of_tool) * tool_path).sum())
    drive = float((_middle(trace.drive) * tool_path).sum())
    adhesion_of_tool = -_middle(trace.adhesion_tool) * (tool_path - ball_path)
    adhesion_of_plate = _middle(trace.adhesion_plate) * ball_path
    adhesion = float((adhesion_of_tool - adhesion_of_plate).sum())

    # Its uses: motion, height, pressing of contacts, impacts.
    contact = _work_of_contact(trace.contact_tool, ball_path - tool_path)
    contact -= _work_of_contact(trace.contact_plate, ball_path)
    impact = float(trace.impact_loss.sum())
    timestep = trace.time[1] - trace.time[0]
    kinetic = _kinetic_gain(trace.weight / GRAVITY, ball_path / timestep)
    kinetic += _kinetic_gain(trace.probe_weight / GRAVITY, tool_path / timestep)
    potential = float(trace.weight * ball_path.sum() + trace.probe_weight * tool_path.sum())

    supply = float(circuit.supply.sum())
    heat = float(circuit.heat.sum())
    work = on_ball + on_tool + drive + adhesion
    electrical = supply - circuit.field_gain - heat - on_ball - on_tool
    mechanical = work - kinetic - potential - contact - impact
    parts = {"joule": heat, "drive": drive, "contact": contact, "impact": impact}
    return EnergyBalance(
        turnover=turnover,
        electrical=electrical / turnover,
        mechanical=mechanical / turnover,
        parts={name: value / turnover for name, value in parts.items()},
    )


def _pull_of_tool(trial: Trial, across: np.ndarray, gap: np.ndarray) -> np.ndarray:
    """Return the pull of the tool on the ball (T,) [N]."""
    if trial.tip is None:
        return np.asarray(pick_force(across, gap, trial.radius, trial.probe_radius))
    splines, axes = read_table(trial.tip).tables
    functions = in_arrays(spline, np)
    place = functions.place_of(gap / trial.radius, trial.probe_radius / trial.radius, axes.tolist())
    factor = functions.value_at(splines[spline.PICK], place)
    return factor * np.asarray(asymptotic_force(across, gap, trial.radius))


class _Circuit(NamedTuple):
    """Energies of the circuit."""

    supply: Steps
    """Work of the source in each step [J]."""
    field_gain: float
    """Energy of the fields at the end, less that at the start [J]."""
    heat: Steps
    """Heat of the contacts in each step [J]."""


def _circuit(trace: Trace, trial: Trial) -> _Circuit:
    """Return the energies of the source, of the fields and of the contacts."""
    sizes = trial.radius, trial.probe_radius, trial.contact_gap
    to_tool = np.asarray(capacitance("pick", trace.gap_tool, *sizes, tip=trial.tip))
    to_plate = np.asarray(capacitance("release", trace.gap_plate, *sizes, tip=trial.tip))
    across = trace.voltage - trace.ball_voltage
    conducted, heat = _conducted(trace, trial, to_tool + to_plate)

    charge_moved = np.diff(to_tool * across) + conducted
    energy = to_tool * across**2 / 2 + to_plate * trace.ball_voltage**2 / 2
    return _Circuit(
        supply=_middle(trace.voltage) * charge_moved,
        field_gain=float(energy[-1] - energy[0]),
        heat=heat,
    )


def _conducted(trace: Trace, trial: Trial, capacitance: np.ndarray) -> tuple[Steps, Steps]:
    """Return the charge that flows from tool to ball in each step [C], and the contacts' heat [J].

    The voltage u of the ball relaxes with R C to that of the divider, from which it is d away: the
    integrals of V - u, of its square and of that of u over a step are taken in closed form, since
    the plate's R C is some ps.

    Args:
        trace: every physics step of the trial.
        trial: its conduction.
        capacitance: of the ball to tool and plate together (T,) [F].
    """
    contacts = trial.contacts
    tool_resistance = np.where(trace.broken, contacts.contact, contacts.leak)
    tool = np.where(trace.gap_tool <= 0, 1 / tool_resistance, 0.0)[:-1]
    plate = np.where(trace.gap_plate <= 0, 1 / contacts.plate_contact, 0.0)[:-1]
    conducts = tool + plate > 0
    conductance = np.where(conducts, tool + plate, 1.0)

    step = np.diff(trace.time)
    voltage = trace.voltage[:-1]
    end = np.where(conducts, voltage * tool / conductance, 0.0)
    away = trace.ball_voltage[:-1] - end
    relaxation = capacitance[:-1] / conductance
    integral = relaxation * -np.expm1(-step / relaxation)
    integral_of_square = relaxation / 2 * -np.expm1(-2 * step / relaxation)

    def squared(final: np.ndarray, difference: np.ndarray) -> np.ndarray:
        """Return the integral of the square of a voltage that relaxes to a final one."""
        mixed = 2 * final * difference * integral
        return final**2 * step + mixed + difference**2 * integral_of_square

    across = voltage - end
    charge = tool * (across * step - away * integral)
    heat = tool * squared(across, -away) + plate * squared(end, away)
    return charge, heat


def _kinetic_gain(mass: float, speed: Steps) -> float:
    """Return the kinetic energy at the end, less that at the start [J]."""
    return float(mass / 2 * (speed[-1] ** 2 - speed[0] ** 2))


def _work_of_contact(force: np.ndarray, path: Steps) -> float:
    """Return the work that contacts of these forces (T,) take [J].

    Their impulses act at the mean of the speeds before and after a step.
    """
    return float((force[1:-1] * _middle(path)).sum())


def _middle(values: np.ndarray) -> np.ndarray:
    """Return the means of neighbouring samples."""
    return (values[1:] + values[:-1]) / 2
