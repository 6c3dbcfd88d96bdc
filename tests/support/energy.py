"""The energy of a trial, by its trace: what source, drive and weight put in, and where it went."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from iswarm_mj.gripper.bench.tracing import Trace
from iswarm_mj.gripper.bench.trial import Trial
from iswarm_mj.gripper.laws.detachment import GRAVITY
from iswarm_mj.gripper.laws.electrostatics import pick_force
from support.capacitance import capacitance

Steps = Float[np.ndarray, "T-1"]


class EnergyBalance(NamedTuple):
    """Energies of a trial, summed over its samples [J]. Each is found by itself, none from another's balance."""

    turnover: float
    """Work of the source without its sign: what errors are compared with."""
    electrical: float
    """What is missing between the source's work and its uses, over the turnover."""
    mechanical: float
    """What is missing between the work on ball and tool and its uses, over the turnover."""
    parts: dict[str, float]
    """Over the turnover: `joule` heat of the contacts, work of the `drive`, what pressing takes, and impacts."""


def energy_balance(trace: Trace, trial: Trial) -> EnergyBalance:
    """Energy of a trial; the sums go over the physics steps, forces and voltages are means of neighbours.

    Args:
        trace: every physics step of the trial.
        trial: its conduction, a circuit, and its effective gap.
    """
    least = trial.contact_gap
    sizes = trial.radius, trial.probe_radius
    above = np.asarray(capacitance("pick", trace.gap_tool, *sizes, least))
    below = np.asarray(capacitance("release", trace.gap_plate, *sizes, least))
    across, mine = trace.voltage - trace.ball_voltage, trace.ball_voltage
    flown, joule = _conducted(trace, trial, above + below)
    voltage = _middle(trace.voltage)
    moved = np.diff(above * across) + flown
    energy = above * across**2 / 2 + below * mine**2 / 2
    up = np.asarray(pick_force(across, np.maximum(trace.gap_tool, least), *sizes))
    ball, tool = np.diff(trace.ball[:, 2]), np.diff(trace.probe[:, 2])
    adhesion = -_middle(trace.adhesion_tool) * (tool - ball) - _middle(trace.adhesion_plate) * ball
    contact = _during(trace.contact_tool, ball - tool) - _during(trace.contact_plate, ball)
    masses = (trace.weight / GRAVITY, ball), (trace.probe_weight / GRAVITY, tool)
    step = trace.time[1] - trace.time[0]
    supply, turnover = float((voltage * moved).sum()), float(np.abs(voltage * moved).sum())
    field, heat, drive = float(energy[-1] - energy[0]), float(joule.sum()), float((_middle(trace.drive) * tool).sum())
    on_ball, on_tool = float((_middle(trace.electrostatic) * ball).sum()), float((-_middle(up) * tool).sum())
    kinetic = float(sum(mass / 2 * (way[-1] ** 2 - way[0] ** 2) / step**2 for mass, way in masses))
    potential = float(trace.weight * ball.sum() + trace.probe_weight * tool.sum())
    impact, worked = float(trace.impact_loss.sum()), on_ball + on_tool + drive + float(adhesion.sum())
    parts = {"joule": heat, "drive": drive, "contact": contact, "impact": impact}
    return EnergyBalance(
        turnover,
        (supply - field - heat - on_ball - on_tool) / turnover,
        (worked - kinetic - potential - contact - impact) / turnover,
        {name: value / turnover for name, value in parts.items()},
    )


def _conducted(trace: Trace, trial: Trial, total: np.ndarray) -> tuple[Steps, Steps]:
    """Charge that flows from the tool to the ball in each step [C], and heat of the contacts [J].

    The voltage u of the ball relaxes with R C to that of the divider, from which it is d away: the integrals of V - u,
    its square and that of u over a step are taken in closed form, since the plate's R C is some ps.
    """
    contacts = trial.contacts
    resistance = np.where(trace.broken, contacts.contact, contacts.leak)
    tool = np.where(trace.gap_tool <= 0, 1 / resistance, 0.0)[:-1]
    plate = np.where(trace.gap_plate <= 0, 1 / contacts.plate_contact, 0.0)[:-1]
    step, voltage = np.diff(trace.time), trace.voltage[:-1]
    conducts = tool + plate > 0
    both = np.where(conducts, tool + plate, 1.0)
    end = np.where(conducts, voltage * tool / both, 0.0)
    away = trace.ball_voltage[:-1] - end
    relaxation = total[:-1] / both
    once, twice = (relaxation / k * -np.expm1(-k * step / relaxation) for k in (1, 2))
    across = voltage - end

    def square(at: np.ndarray, d: np.ndarray) -> np.ndarray:
        return at**2 * step + 2 * at * d * once + d**2 * twice

    return tool * (across * step - away * once), tool * square(across, -away) + plate * square(end, away)


def _during(force: np.ndarray, way: Steps) -> float:
    """What contacts of these forces (T,) take; their impulses act at the mean of the speeds before and after a step."""
    return float((force[1:-1] * _middle(way)).sum())


def _middle(values: np.ndarray) -> np.ndarray:
    return (values[1:] + values[:-1]) / 2
