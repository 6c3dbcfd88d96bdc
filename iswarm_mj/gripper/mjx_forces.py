"""The gripper's forces in MJX, for `impl="jax"` and `impl="warp"` alike: the same laws, and the plugins' attributes.

    spec = mujoco.MjSpec.from_file("models/bench.xml")
    forces, portable = gripper_forces(spec.compile()), mjx_compatible(spec)
    mx, dx = mjx.put_model(portable, impl=impl), mjx.make_data(portable, impl=impl)
    state = first_state(forces)
    dx, force = step(forces, mx, dx, state)      # in jit, scan, vmap; next with force.state

MJX has no plugins and drops their forces, so here they enter as `xfrc_applied`. `GripperForces` is a pytree whose
arrays can be replaced and batched by `vmap`, and so can the radii in the model (`mjx_model.resize`), and the voltages
and the probe's path in `Data.ctrl`. The docstring of `plugin` describes the forces.
"""

import math
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import jax
import jax.numpy as jnp
import mujoco
from jaxtyping import Float

from iswarm_mj.engines.mjx.api import mjx
from iswarm_mj.gripper import contact, plugin
from iswarm_mj.gripper.laws import spline
from iswarm_mj.gripper.laws.adhesion import humidity_factor
from iswarm_mj.gripper.laws.electrostatics import asymptotic_force
from iswarm_mj.gripper.laws.probe_table import tables
from iswarm_mj.gripper.native.attributes import ATTRIBUTES, ELECTROSTATIC, NUMBER
from iswarm_mj.gripper.units import MS, NN, PRESSURE, UM
from iswarm_mj.utils.arrays import Array
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.scalar_backends import in_arrays

_contact, _spline = in_arrays(contact, jnp), in_arrays(spline, jnp)


class State(NamedTuple):
    """What a ball keeps from one step to the next; see the docstring of `plugin`."""

    potential: Float[Array, ""]
    """`contact.ON_PLATE` or `ON_PROBE`; in a circuit the nearer of the two."""
    charge: Float[Array, ""]
    """In a circuit [fC]."""
    broken: Float[Array, ""]
    """1 if the oxide of the present contact broke down."""
    before: Float[Array, "P"]
    """Gaps one step earlier [um]."""
    closing: Float[Array, "P"]
    """Speeds with which they closed then [um/ms]."""
    rebound: Float[Array, "P"]
    """1 while an impact throws the ball back."""


class Pair(NamedTuple):
    """A ball and a surface that adhere."""

    instance: str
    """Of the adhesion plugin."""
    ball: int
    """Its geom."""
    surface: int
    """Its geom."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class GripperForces:
    """Attributes of a model's plugins: arrays, and static ids.

    Attributes:
        numbers: attributes that are numbers, by instance and name, see `native.attributes.ATTRIBUTES`.
        pairs: P pairs of geoms, in the order of the plugin instances.
        circuit: instance of the electrostatic plugin.
        ball, probe, plate: geoms.
        voltage: actuator.
        plane: whether each geom is a plane.
        bodies: the body of each geom.
    """

    numbers: dict[tuple[str, str], Array]
    pairs: tuple[Pair, ...] = field(metadata={"static": True})
    circuit: str = field(metadata={"static": True})
    ball: int = field(metadata={"static": True})
    probe: int = field(metadata={"static": True})
    plate: int = field(metadata={"static": True})
    voltage: int = field(metadata={"static": True})
    plane: tuple[bool, ...] = field(metadata={"static": True})
    bodies: tuple[int, ...] = field(metadata={"static": True})

    def having(self, numbers: dict[tuple[str, str], Array]) -> "GripperForces":
        """The same forces with other values of these numbers."""
        return replace(self, numbers=self.numbers | numbers)

    @property
    def tool_and_plate(self) -> tuple[int, int]:
        """Which of the pairs are the ball's with the tool and with the plate."""
        surfaces = [pair.surface for pair in self.pairs]
        return surfaces.index(self.probe), surfaces.index(self.plate)


def gripper_forces(model: mujoco.MjModel) -> GripperForces:
    """Forces that a model declares: any number of instances of the adhesion plugin, one of the electrostatic plugin."""
    state = mujoco.MjData(model).plugin_state
    values = {key: state[index] for key, index in plugin.state_indices(model).items()}
    circuits = [instance for instance, name in values if name == "probe"]
    if len(circuits) != 1:
        raise UserError(f"The model has {len(circuits)} plugin instances of {ELECTROSTATIC}; give it exactly one.")
    ids = {name: int(values[circuits[0], name]) for name in ("ball", "probe", "plate", "voltage")}
    known = {attribute.name for table in ATTRIBUTES.values() for attribute in table if attribute.kind == NUMBER}
    return GripperForces(
        {key: jnp.asarray(value) for key, value in values.items() if key[1] in known},
        tuple(
            Pair(it, int(values[it, "ball"]), int(values[it, "surface"])) for it, name in values if name == "surface"
        ),
        circuits[0],
        **ids,
        plane=tuple(bool(kind == mujoco.mjtGeom.mjGEOM_PLANE) for kind in model.geom_type),
        bodies=tuple(model.geom_bodyid.tolist()),
    )


def first_state(forces: GripperForces) -> State:
    """State of a ball after a reset."""
    zero, zeros = jnp.zeros(()), jnp.zeros(len(forces.pairs))
    return State(jnp.asarray(contact.ON_PROBE), zero, zero, zeros, zeros, zeros)


class Force(NamedTuple):
    """The forces at one moment."""

    applied: Float[Array, "nbody 6"]
    """For `xfrc_applied`."""
    adhesion: Float[Array, "P"]
    """Towards the surface [nN]."""
    electrostatic: Float[Array, ""]
    """Positive towards the probe, negative towards the plate [nN]."""
    gaps: Float[Array, "P"]
    """Between the pairs [um]."""
    ball_voltage: Float[Array, ""]
    """Of the ball against the plate [V]."""
    pulls: tuple[Array, Array]
    """To probe and plate, whose difference is `electrostatic` [nN]."""
    capacitances: tuple[Array, Array]
    """Of the ball to probe and plate [fF]."""
    landing_speed: Float[Array, "P"]
    """Of contacts that begin, 0 otherwise [um/ms]."""
    state: State
    """After this step."""


def gripper_force(forces: GripperForces, model: mjx.Model, data: mjx.Data, state: State) -> Force:
    """Forces at the present positions and the voltage in `data.ctrl`.

    Args:
        forces: attributes and ids.
        model: of MJX, with the radii in its geoms.
        data: of MJX, whose bodies are where `mjx.kinematics` places them.
        state: as the last call returned it.
    """
    total = jnp.zeros_like(data.xfrc_applied)
    mass = model.body_mass[forces.bodies[forces.ball]]
    adhesion, gaps, rebounds, landings = [], [], [], []
    for i, (instance, ball, surface) in enumerate(forces.pairs):
        own = {name: value for (it, name), value in forces.numbers.items() if it == instance}
        gap, normal = _gap(forces, model, data, ball, surface)
        radius, before = model.geom_size[ball, 0], state.before[i]
        work = own["work"] * humidity_factor(own["humidity"]) * (NN / UM)
        hits = (gap <= 0) & (before > 0)
        speed = jnp.where(hits, (before - gap) / model.opt.timestep, 1.0)
        density = mass / (4 / 3 * math.pi * radius**3) * 1e9
        numbers = own["restitution"], own["yield_pressure"] * PRESSURE, own["modulus"] * PRESSURE
        ratio = _contact.rebound_ratio(speed * (UM / MS), density, radius * UM, work, *numbers)
        begins = hits & (ratio > 0)
        push = jnp.where(begins, mass * (1 + ratio) * speed / model.opt.timestep, 0.0)
        force = _contact.adhesion_force(work, own["hamaker"] * (NN * UM), radius * UM, gap * UM) / NN
        force = jnp.where(begins | (state.rebound[i] > 0), 0.0, force)
        total += _attraction(forces, model, data, (ball, surface), gap, (force - push) * normal)
        adhesion, gaps = [*adhesion, force], [*gaps, gap]
        rebounds = [*rebounds, _contact.rebounds_on(begins, state.rebound[i], gap, before)]
        landings = [*landings, _contact.speed_at_contact(before, gap, state.closing[i], speed)]
    probe_gap, to_probe = _gap(forces, model, data, forces.ball, forces.probe)
    plate_gap, to_plate = _gap(forces, model, data, forces.ball, forces.plate)
    own = {name: value for (it, name), value in forces.numbers.items() if it == forces.circuit}
    voltage, has_circuit, least = data.ctrl[forces.voltage], own["leak"] > 0, own["contact_gap"]
    radius, probe_radius = model.geom_size[forces.ball, 0], model.geom_size[forces.probe, 0]
    splines, axes = (jnp.asarray(table, radius.dtype) for table in tables())
    pick, above = _spline.shape_of(0, radius, probe_gap, least, probe_radius, splines, axes)
    release, below = _spline.shape_of(1, radius, plate_gap, least, probe_radius, splines, axes)
    capacitances = above, below
    mine = _contact.ball_voltage(has_circuit, state.charge, state.potential, voltage, capacitances, plate_gap)
    across = voltage - mine
    up = pick * asymptotic_force(across, jnp.maximum(probe_gap, least) * UM, radius * UM) / NN
    down = release * asymptotic_force(mine, jnp.maximum(plate_gap, least) * UM, radius * UM) / NN
    total += _attraction(forces, model, data, (forces.ball, forces.probe), probe_gap, up * to_probe)
    total += _attraction(forces, model, data, (forces.ball, forces.plate), plate_gap, down * to_plate)
    broken = _contact.is_broken(across, probe_gap, state.broken, least, own["oxide"] * own["breakdown"])
    leak = jnp.where(has_circuit, own["leak"], 1.0)
    conducts = has_circuit & (probe_gap <= 0), has_circuit & (plate_gap <= 0)
    through = 1 / jnp.where(broken > 0, own["contact"], leak), 1 / own["plate_contact"]
    flows = [jnp.where(touches, each, 0.0) for touches, each in zip(conducts, through, strict=True)]
    charge = _contact.relaxed_charge(state.charge, mine, voltage, capacitances, *flows, model.opt.timestep)
    limits = least, own["off_voltage"]
    potential = _contact.next_potential(has_circuit, state.potential, mine, voltage, (probe_gap, plate_gap), *limits)
    broken = jnp.where(has_circuit, broken, state.broken)
    now = jnp.stack(gaps)
    closing = (state.before - now) / model.opt.timestep
    new = State(potential, charge, broken, now, closing, jnp.stack(rebounds))
    return Force(
        total,
        jnp.stack(adhesion),
        up - down,
        now,
        mine,
        (up, down),
        capacitances,
        jnp.stack(landings),
        new,
    )


def step(forces: GripperForces, model: mjx.Model, data: mjx.Data, state: State) -> tuple[mjx.Data, Force]:
    """One physics step with the gripper's forces; arguments as for `gripper_force`.

    Returns:
        The data, and the force that acted, with the state for the next step.
    """
    force = gripper_force(forces, model, mjx.kinematics(model, data), state)
    return mjx.step(model, data.replace(xfrc_applied=force.applied)), force


def _gap(forces: GripperForces, model: mjx.Model, data: mjx.Data, ball: int, surface: int) -> tuple[Array, Array]:
    """Gap from a plane or a cylinder to a ball [um], and the unit vector (3,) that points along it to the ball."""
    axis = data.geom_xmat[surface].reshape(3, 3)[:, 2]
    vector = data.geom_xpos[ball] - data.geom_xpos[surface]
    along = vector @ axis
    radius = model.geom_size[ball, 0]
    if forces.plane[surface]:
        return along - radius, axis
    size, half = model.geom_size[surface, 0], model.geom_size[surface, 2]  # of the prism, see `mjx_compatible`
    aside = vector - along * axis
    distance_aside = jnp.sqrt(jnp.maximum(aside @ aside, 1e-12))
    aside = jnp.where(distance_aside > size, 1 - size / distance_aside, 0.0) * aside
    vector = (along - jnp.clip(along, -half, half)) * axis + aside
    distance = jnp.sqrt(jnp.maximum(vector @ vector, 1e-12))
    return distance - radius, vector / distance


def _attraction(
    forces: GripperForces, model: mjx.Model, data: mjx.Data, pair: tuple[int, int], gap: Array, force: Array
) -> Array:
    """Forces and torques (nbody, 6) of a pull (3,) of the ball on the surface, and of the surface on the ball."""
    strength = jnp.sqrt(jnp.maximum(force @ force, 1e-30))
    point = data.geom_xpos[pair[0]] - (model.geom_size[pair[0], 0] + gap / 2) * force / strength
    total = jnp.zeros_like(data.xfrc_applied)
    for geom, own in zip(pair, (-force, force), strict=True):
        body = forces.bodies[geom]
        total = total.at[body].add(jnp.concatenate([own, jnp.cross(point - data.xipos[body], own)]))
    return total
