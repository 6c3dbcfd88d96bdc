"""What a ball keeps between physics steps in MJX: its charge, the state of its contacts; and its impacts.

The numbers come from `mjx_forces.GripperForces`, here `forces`.
"""

import math
from typing import Any, NamedTuple

import jax.numpy as jnp
from jaxtyping import Float

from iswarm_mj.gripper.laws.humidity import humidity_factor
from iswarm_mj.gripper.laws.restitution import plastic_restitution, sticking_speed, with_adhesion, yield_speed
from iswarm_mj.gripper.units import MS, NN, UM
from iswarm_mj.utils.arrays import Array

ON_PLATE, ON_PROBE = 0.0, 1.0
"""The electrode whose potential the ball has; it starts with the probe's, and takes the plate's on contact."""


class State(NamedTuple):
    """What a ball keeps from one step to the next; see the docstring of `plugin`."""

    potential: Float[Array, ""]
    """`ON_PLATE` or `ON_PROBE`; in a circuit the nearer of the two."""
    charge: Float[Array, ""]
    """In a circuit [fC]."""
    broken: Float[Array, ""]
    """1 if the oxide of the present contact broke down."""
    before: Float[Array, "P"]
    """Gaps one step earlier [um]."""
    rebound: Float[Array, "P"]
    """1 while an impact throws the ball back."""


class Circuit(NamedTuple):
    """Capacitances of the ball to probe and plate [fF], the probe's voltage, and whether the circuit decides."""

    above: Array
    below: Array
    voltage: Array
    is_on: Array

    def ball_voltage(self, charge: Array) -> Array:
        """Voltage of a ball with this charge [V]."""
        return (charge + self.above * self.voltage) / (self.above + self.below)


def next_potential(
    forces: Any, circuit: Circuit, state: State, mine: Array, gaps: tuple[Array, Array], time: Array
) -> State:
    """State after a step of a ball with this voltage at these gaps to probe and plate."""
    probe_gap, plate_gap = gaps
    across = circuit.voltage - mine
    breaks = (probe_gap <= 0) & (jnp.abs(across) >= forces.oxide * forces.breakdown)
    broken = jnp.where(breaks, 1.0, jnp.where(probe_gap > forces.contact_gap, 0.0, state.broken))
    leak = jnp.where(circuit.is_on, forces.leak, 1.0)
    to_probe = jnp.where(probe_gap <= 0, 1 / jnp.where(broken > 0, forces.contact, leak), 0.0)
    to_plate = jnp.where(plate_gap <= 0, 1 / forces.plate_contact, 0.0)
    conductance = to_probe + to_plate
    conducts = circuit.is_on & (conductance > 0)
    end = circuit.voltage * to_probe / jnp.where(conducts, conductance, 1.0)
    relaxed = end + (mine - end) * jnp.exp(-conductance * time / (circuit.above + circuit.below))
    charge = jnp.where(conducts, circuit.below * relaxed - circuit.above * (circuit.voltage - relaxed), state.charge)
    equalises = (probe_gap <= forces.contact_gap) & (jnp.abs(circuit.voltage) <= forces.off_voltage)
    switched = jnp.where(plate_gap <= 0, ON_PLATE, jnp.where(equalises, ON_PROBE, state.potential))
    nearer = jnp.where(jnp.abs(mine) > jnp.abs(across), ON_PROBE, ON_PLATE)
    return state._replace(
        potential=jnp.where(circuit.is_on, nearer, switched),
        charge=charge,
        broken=jnp.where(circuit.is_on, broken, state.broken),
    )


def rebound_ratio(forces: Any, i: int, speed: Array, mass: Array, radius: Array) -> Array:
    """Speed after an impact of the i-th pair over that before [um/ms], 0 if the ball stays."""
    pressure, modulus = (number[i] * (NN / UM**2) for number in (forces.yield_pressure, forces.modulus))
    work = forces.work[i] * humidity_factor(forces.humidity[i]) * (NN / UM)
    speed, density = speed * (UM / MS), mass / (4 / 3 * math.pi * radius**3) * 1e9
    has_modulus = modulus > 0
    safe = jnp.where(has_modulus, modulus, 1.0)
    yields_at = yield_speed(pressure, safe, density)
    ratio = jnp.where((pressure > 0) & has_modulus, plastic_restitution(speed, yields_at), forces.restitution[i])
    kept = jnp.where(has_modulus, sticking_speed(work, radius * UM, safe, density), 0.0)
    return jnp.where(ratio > 0, with_adhesion(ratio, speed, kept), 0.0)
