"""The gripper's forces in MJX, with the laws and attributes of the plugins.

For `impl="jax"` and `impl="warp"`:

    spec = mujoco.MjSpec.from_file("models/bench.xml")
    forces, portable = gripper_forces(spec.compile()), mjx_compatible(spec)
    mx, dx = mjx.put_model(portable, impl=impl), mjx.make_data(portable, impl=impl)
    state = first_state(forces)
    dx, force = step(forces, mx, dx, state)      # in jit, scan, vmap; next with force.state

MJX has no plugins and drops their forces, so here they enter as `xfrc_applied`. `GripperForces` is
a pytree whose arrays can be replaced and batched by `vmap`, and so can the radii in the model
(`mjx_model.resize`), and the voltages and the probe's path in `Data.ctrl`. The docstring of
`plugin` describes the forces.
"""

import math
from dataclasses import dataclass, field, replace
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import mujoco
from jaxtyping import Bool, Float

from iswarm_mj.engines.mjx.api import mjx
from iswarm_mj.gripper import contact, plugin
from iswarm_mj.gripper.laws import spline
from iswarm_mj.gripper.laws.adhesion import humidity_factor
from iswarm_mj.gripper.laws.electrostatics import asymptotic_force
from iswarm_mj.gripper.laws.probe_table import tables
from iswarm_mj.gripper.native.abi import tip_of_numeric
from iswarm_mj.gripper.native.attributes import ATTRIBUTES, ELECTROSTATIC, NUMBER
from iswarm_mj.gripper.units import MS, NN, PRESSURE, UG_PER_UM3, UM
from iswarm_mj.utils.arrays import Array
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.scalar_backends import in_arrays

# Functions of these modules on arrays of JAX; constants are taken from the modules themselves.
_contact = in_arrays(contact, jnp)
_spline = in_arrays(spline, jnp)


class State(NamedTuple):
    """State that a ball keeps from one step to the next; see the docstring of `plugin`."""

    potential: Float[Array, ""]
    """`contact.ON_PLATE` or `ON_PROBE`; in a circuit the nearer of the two."""
    charge: Float[Array, ""]
    """Charge of the ball in a circuit [fC]."""
    broken: Float[Array, ""]
    """1 if the oxide of the present contact broke down."""
    before: Float[Array, "P"]
    """Gaps one step earlier [um]."""
    closing: Float[Array, "P"]
    """Speeds with which the gaps closed then [um/ms]."""
    rebound: Float[Array, "P"]
    """1 while an impact throws the ball back."""


class Pair(NamedTuple):
    """A ball and a surface that adhere."""

    instance: str
    """Instance of the adhesion plugin."""
    ball: int
    """Geom of the ball."""
    surface: int
    """Geom of the surface."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class GripperForces:
    """Attributes of a model's plugins: arrays, and static ids.

    Attributes:
        numbers: numeric attributes by instance and name, see `native.attributes.ATTRIBUTES`.
        tables: splines and axes of the probe, flat or of another tip, see `probe_table.tables`.
        pairs: P pairs of geoms, in the order of the plugin instances.
        circuit: instance of the electrostatic plugin.
        ball, probe, plate: geoms.
        voltage: actuator.
        plane: True for each geom that is a plane.
        bodies: body of each geom.
    """

    numbers: dict[tuple[str, str], Array]
    tables: tuple[Float[Array, "4 R C"], Float[Array, "2 5"]]
    pairs: tuple[Pair, ...] = field(metadata={"static": True})
    circuit: str = field(metadata={"static": True})
    ball: int = field(metadata={"static": True})
    probe: int = field(metadata={"static": True})
    plate: int = field(metadata={"static": True})
    voltage: int = field(metadata={"static": True})
    plane: tuple[bool, ...] = field(metadata={"static": True})
    bodies: tuple[int, ...] = field(metadata={"static": True})

    def having(self, numbers: dict[tuple[str, str], Array]) -> "GripperForces":
        """Return the same forces with other values of these numbers."""
        return replace(self, numbers=self.numbers | numbers)

    def attributes(self, instance: str) -> dict[str, Array]:
        """Return the numeric attributes of a plugin instance by name."""
        return {name: value for (owner, name), value in self.numbers.items() if owner == instance}

    @property
    def tool_and_plate(self) -> tuple[int, int]:
        """Indices of the ball's pairs with the tool and with the plate."""
        surfaces = [pair.surface for pair in self.pairs]
        return surfaces.index(self.probe), surfaces.index(self.plate)


def gripper_forces(model: mujoco.MjModel) -> GripperForces:
    """Return the forces that a model declares.

    Args:
        model: has any number of instances of the adhesion plugin, and one of the electrostatic one.

    Raises:
        UserError: the model has no instance of the electrostatic plugin, or several.
    """
    state = mujoco.MjData(model).plugin_state
    values = {place: state[index] for place, index in plugin.state_indices(model).items()}

    circuits = [instance for instance, name in values if name == "probe"]
    count = len(circuits)
    if count != 1:
        raise UserError(
            f"The model has {count} plugin instances of {ELECTROSTATIC}; give it exactly one.",
        )
    circuit = circuits[0]

    pairs = [
        Pair(instance, int(values[instance, "ball"]), int(values[instance, "surface"]))
        for instance, name in values
        if name == "surface"
    ]
    attributes = [attribute for table in ATTRIBUTES.values() for attribute in table]
    numeric = {attribute.name for attribute in attributes if attribute.kind == NUMBER}
    numbers: dict[tuple[str, str], Array] = {
        place: jnp.asarray(value) for place, value in values.items() if place[1] in numeric
    }

    plane = mujoco.mjtGeom.mjGEOM_PLANE
    return GripperForces(
        numbers=numbers,
        tables=_tables_of(model, int(values[circuit, "tip"])),
        pairs=tuple(pairs),
        circuit=circuit,
        ball=int(values[circuit, "ball"]),
        probe=int(values[circuit, "probe"]),
        plate=int(values[circuit, "plate"]),
        voltage=int(values[circuit, "voltage"]),
        plane=tuple(bool(kind == plane) for kind in model.geom_type),
        bodies=tuple(model.geom_bodyid.tolist()),
    )


def _tables_of(model: mujoco.MjModel, tip: int) -> tuple[Array, Array]:
    """Return splines and axes in a numeric field of a model, or of the flat probe for -1."""
    if tip < 0:
        splines, axes = tables()
    else:
        first = int(model.numeric_adr[tip])
        numbers = model.numeric_data[first : first + int(model.numeric_size[tip])]
        splines, axes = tip_of_numeric(numbers)
    return jnp.asarray(splines), jnp.asarray(axes)


def first_state(forces: GripperForces) -> State:
    """Return the state of a ball after a reset."""
    zero = jnp.zeros(())
    zeros = jnp.zeros(len(forces.pairs))
    return State(
        potential=jnp.asarray(contact.ON_PROBE),
        charge=zero,
        broken=zero,
        before=zeros,
        closing=zeros,
        rebound=zeros,
    )


class Force(NamedTuple):
    """The forces at one moment."""

    applied: Float[Array, "nbody 6"]
    """Forces and torques for `xfrc_applied`."""
    adhesion: Float[Array, "P"]
    """Attraction of the ball by each surface [nN]."""
    electrostatic: Float[Array, ""]
    """Electrostatic force, positive towards the probe, negative towards the plate [nN]."""
    gaps: Float[Array, "P"]
    """Gap of each pair [um]."""
    ball_voltage: Float[Array, ""]
    """Voltage of the ball against the plate [V]."""
    pulls: tuple[Array, Array]
    """Pulls to probe and plate, whose difference is `electrostatic` [nN]."""
    capacitances: tuple[Array, Array]
    """Capacitances of the ball to probe and plate [fF]."""
    landing_speed: Float[Array, "P"]
    """Closing speed of each contact that begins, 0 for others [um/ms]."""
    state: State
    """State after this step."""


class _Adhesion(NamedTuple):
    """Adhesion and impact of one pair at one moment."""

    applied: Float[Array, "nbody 6"]
    """Forces and torques for `xfrc_applied`."""
    gap: Array
    """Gap of the pair [um]."""
    force: Array
    """Attraction of the ball by the surface [nN]."""
    rebound: Array
    """1 while an impact throws the ball back, after this step."""
    landing_speed: Array
    """Closing speed of a contact that begins, 0 otherwise [um/ms]."""


class _Electrostatics(NamedTuple):
    """Electrostatic forces on the ball at one moment; pairs are those of probe and plate."""

    applied: tuple[Array, Array]
    """Forces and torques of both pulls for `xfrc_applied` (nbody, 6)."""
    gaps: tuple[Array, Array]
    """Gaps [um]."""
    capacitances: tuple[Array, Array]
    """Capacitances of the ball [fF]."""
    pulls: tuple[Array, Array]
    """Pulls [nN]."""
    ball_voltage: Array
    """Voltage of the ball against the plate [V]."""


def gripper_force(forces: GripperForces, model: mjx.Model, data: mjx.Data, state: State) -> Force:
    """Return the forces at the present positions and the voltage in `data.ctrl`.

    Args:
        forces: attributes and ids.
        model: of MJX, with the radii in its geoms.
        data: of MJX, whose bodies are where `mjx.kinematics` places them.
        state: as the last call returned it.
    """
    adhesions = [_adhesion(forces, model, data, state, index) for index in range(len(forces.pairs))]
    electrostatics = _electrostatics(forces, model, data, state)

    applied = jnp.zeros_like(data.xfrc_applied)
    for part in (*(adhesion.applied for adhesion in adhesions), *electrostatics.applied):
        applied += part

    gaps = jnp.stack([adhesion.gap for adhesion in adhesions])
    next_state = _circuit_after_step(forces, model, data, state, electrostatics)._replace(
        before=gaps,
        closing=(state.before - gaps) / model.opt.timestep,
        rebound=jnp.stack([adhesion.rebound for adhesion in adhesions]),
    )
    to_probe, to_plate = electrostatics.pulls
    return Force(
        applied=applied,
        adhesion=jnp.stack([adhesion.force for adhesion in adhesions]),
        electrostatic=to_probe - to_plate,
        gaps=gaps,
        ball_voltage=electrostatics.ball_voltage,
        pulls=electrostatics.pulls,
        capacitances=electrostatics.capacitances,
        landing_speed=jnp.stack([adhesion.landing_speed for adhesion in adhesions]),
        state=next_state,
    )


def step(
    forces: GripperForces,
    model: mjx.Model,
    data: mjx.Data,
    state: State,
) -> tuple[mjx.Data, Force]:
    """Take one physics step with the gripper's forces; arguments as for `gripper_force`.

    Returns:
        The data, and the force that acted, with the state for the next step.
    """
    force = gripper_force(forces, model, mjx.kinematics(model, data), state)
    return mjx.step(model, data.replace(xfrc_applied=force.applied)), force


def _adhesion(
    forces: GripperForces,
    model: mjx.Model,
    data: mjx.Data,
    state: State,
    index: int,
) -> _Adhesion:
    """Return the adhesion of a pair, and the force m (1 + e) v / dt of an impact in this step.

    A ball that an impact throws back does not adhere, since the restitution e holds that loss.
    """
    pair = forces.pairs[index]
    attributes = forces.attributes(pair.instance)
    timestep = model.opt.timestep
    mass = model.body_mass[forces.bodies[forces.ball]]
    radius = model.geom_size[pair.ball, 0]
    work = attributes["work"] * humidity_factor(attributes["humidity"]) * (NN / UM)

    gap, normal = _gap(forces, model, data, pair.ball, pair.surface)
    previous_gap = state.before[index]

    # An impact: the contact begins in this step.
    hits = (gap <= 0) & (previous_gap > 0)
    speed = jnp.where(hits, (previous_gap - gap) / timestep, 1.0)
    restitution = _contact.rebound_ratio(
        speed=speed * (UM / MS),
        density=mass / (4 / 3 * math.pi * radius**3) * UG_PER_UM3,
        radius=radius * UM,
        work=work,
        restitution=attributes["restitution"],
        pressure=attributes["yield_pressure"] * PRESSURE,
        modulus=attributes["modulus"] * PRESSURE,
    )
    is_thrown_back = hits & (restitution > 0)
    push = jnp.where(is_thrown_back, mass * (1 + restitution) * speed / timestep, 0.0)

    adhesion = _contact.adhesion_force(
        work=work,
        hamaker=attributes["hamaker"] * (NN * UM),
        radius=radius * UM,
        gap=gap * UM,
    )
    is_leaving = is_thrown_back | (state.rebound[index] > 0)
    force = jnp.where(is_leaving, 0.0, adhesion / NN)

    return _Adhesion(
        applied=_attraction(
            forces,
            model,
            data,
            (pair.ball, pair.surface),
            gap,
            (force - push) * normal,
        ),
        gap=gap,
        force=force,
        rebound=_contact.rebounds_on(is_thrown_back, state.rebound[index], gap, previous_gap),
        landing_speed=_contact.speed_at_contact(previous_gap, gap, state.closing[index], speed),
    )


def _electrostatics(
    forces: GripperForces,
    model: mjx.Model,
    data: mjx.Data,
    state: State,
) -> _Electrostatics:
    """Return the electrostatic pulls of probe and plate on the ball, f pi eps0 U^2 R / D.

    U is the voltage across the gap, D the gap, at least that of a contact, R the radius of the
    ball, and f the shape factor of `spline.shape_of`. Lengths of the model are in um, its forces in
    nN and its capacitances in fF; the law takes and returns SI units.

    Args:
        forces: attributes of the circuit, and ids.
        model: of MJX, with the radii in its geoms.
        data: of MJX, with the voltage of the probe in `ctrl`.
        state: charge of the ball, or the electrode whose potential it has without a circuit.
    """
    attributes = forces.attributes(forces.circuit)
    least_gap = attributes["contact_gap"]
    radius = model.geom_size[forces.ball, 0]

    # Gaps [um], and unit vectors that point along them to the ball.
    probe_gap, probe_normal = _gap(forces, model, data, forces.ball, forces.probe)
    plate_gap, plate_normal = _gap(forces, model, data, forces.ball, forces.plate)

    # Shape factors of both pulls, and the ball's capacitances [fF].
    splines, axes = forces.tables
    shape_at = partial(
        _spline.shape_of,
        radius=radius,
        least_gap=least_gap,
        probe_radius=model.geom_size[forces.probe, 0],
        splines=jnp.asarray(splines, radius.dtype),
        axes=jnp.asarray(axes, radius.dtype),
    )
    pick_shape, probe_capacitance = shape_at(spline.PICK, gap=probe_gap)
    release_shape, plate_capacitance = shape_at(spline.RELEASE, gap=plate_gap)

    # The ball's voltage against the plate. A leak of 0 stands for no circuit.
    voltage = data.ctrl[forces.voltage]
    ball_voltage = _contact.ball_voltage(
        has_circuit=attributes["leak"] > 0,
        charge=state.charge,
        potential=state.potential,
        voltage=voltage,
        capacitances=(probe_capacitance, plate_capacitance),
        plate_gap=plate_gap,
    )

    probe_law_gap = jnp.maximum(probe_gap, least_gap)
    plate_law_gap = jnp.maximum(plate_gap, least_gap)
    probe_pull = _pull(pick_shape, voltage - ball_voltage, probe_law_gap, radius)
    plate_pull = _pull(release_shape, ball_voltage, plate_law_gap, radius)

    ball_and_probe = forces.ball, forces.probe
    ball_and_plate = forces.ball, forces.plate
    return _Electrostatics(
        applied=(
            _attraction(forces, model, data, ball_and_probe, probe_gap, probe_pull * probe_normal),
            _attraction(forces, model, data, ball_and_plate, plate_gap, plate_pull * plate_normal),
        ),
        gaps=(probe_gap, plate_gap),
        capacitances=(probe_capacitance, plate_capacitance),
        pulls=(probe_pull, plate_pull),
        ball_voltage=ball_voltage,
    )


def _pull(shape: Array, voltage: Array, gap: Array, radius: Array) -> Array:
    """Return the pull of an electrode on the ball, by Eq. 2 with a shape factor [nN].

    Args:
        shape: factor by which the pull differs from that of Eq. 2.
        voltage: voltage across the gap [V].
        gap: gap of the law [um].
        radius: radius of the ball [um].
    """
    return shape * asymptotic_force(voltage, gap * UM, radius * UM) / NN


def _circuit_after_step(
    forces: GripperForces,
    model: mjx.Model,
    data: mjx.Data,
    state: State,
    electrostatics: _Electrostatics,
) -> State:
    """Return the state with the charge, the oxide and the potential after a step."""
    attributes = forces.attributes(forces.circuit)
    has_circuit = attributes["leak"] > 0
    least_gap = attributes["contact_gap"]
    voltage = data.ctrl[forces.voltage]
    ball_voltage = electrostatics.ball_voltage
    probe_gap, plate_gap = electrostatics.gaps

    broken = _contact.is_broken(
        across=voltage - ball_voltage,
        probe_gap=probe_gap,
        broken=state.broken,
        least_gap=least_gap,
        strength=attributes["oxide"] * attributes["breakdown"],
    )
    leak = jnp.where(has_circuit, attributes["leak"], 1.0)
    probe_conductance = 1 / jnp.where(broken > 0, attributes["contact"], leak)
    plate_conductance = 1 / attributes["plate_contact"]
    charge = _contact.relaxed_charge(
        charge=state.charge,
        ball_voltage=ball_voltage,
        voltage=voltage,
        capacitances=electrostatics.capacitances,
        probe_conductance=_where_touching(has_circuit, probe_gap, probe_conductance),
        plate_conductance=_where_touching(has_circuit, plate_gap, plate_conductance),
        time=model.opt.timestep,
    )
    potential = _contact.next_potential(
        has_circuit=has_circuit,
        potential=state.potential,
        ball_voltage=ball_voltage,
        voltage=voltage,
        gaps=electrostatics.gaps,
        least_gap=least_gap,
        off_voltage=attributes["off_voltage"],
    )
    return state._replace(
        potential=potential,
        charge=charge,
        broken=jnp.where(has_circuit, broken, state.broken),
    )


def _where_touching(
    has_circuit: Bool[Array, ""], gap: Float[Array, ""], conductance: Float[Array, ""]
) -> Float[Array, ""]:
    """Return the conductance of a contact in a circuit, 0 out of contact."""
    return jnp.where(has_circuit & (gap <= 0), conductance, 0.0)


def _gap(
    forces: GripperForces,
    model: mjx.Model,
    data: mjx.Data,
    ball: int,
    surface: int,
) -> tuple[Array, Array]:
    """Return the gap from a plane or a cylinder to a ball [um].

    Also the unit vector (3,) that points along it to the ball.
    """
    axis = data.geom_xmat[surface].reshape(3, 3)[:, 2]
    vector = data.geom_xpos[ball] - data.geom_xpos[surface]
    height = vector @ axis
    ball_radius = model.geom_size[ball, 0]
    if forces.plane[surface]:
        return height - ball_radius, axis

    # The size is that of the prism which stands for the cylinder, see `mjx_compatible`.
    cylinder_radius = model.geom_size[surface, 0]
    half_length = model.geom_size[surface, 2]

    # From the nearest point of the cylinder: what is left beyond its radius and its ends.
    sideways = vector - height * axis
    sideways_distance = jnp.sqrt(jnp.maximum(sideways @ sideways, 1e-12))
    is_beside = sideways_distance > cylinder_radius
    share_beyond = jnp.where(is_beside, 1 - cylinder_radius / sideways_distance, 0.0)
    height_beyond = height - jnp.clip(height, -half_length, half_length)
    vector = height_beyond * axis + share_beyond * sideways

    distance = jnp.sqrt(jnp.maximum(vector @ vector, 1e-12))
    return distance - ball_radius, vector / distance


def _attraction(
    forces: GripperForces,
    model: mjx.Model,
    data: mjx.Data,
    pair: tuple[int, int],
    gap: Array,
    pull: Array,
) -> Array:
    """Return forces and torques (nbody, 6) of a pull that ball and surface exert on each other.

    Args:
        forces: ids.
        model: of MJX.
        data: of MJX.
        pair: geoms of the ball and of the surface.
        gap: between them [um].
        pull: force on the surface (3,), along the normal to the ball [nN]; the ball has the
            opposite.
    """
    ball, _ = pair
    strength = jnp.sqrt(jnp.maximum(pull @ pull, 1e-30))
    middle = model.geom_size[ball, 0] + gap / 2
    point = data.geom_xpos[ball] - middle * pull / strength

    total = jnp.zeros_like(data.xfrc_applied)
    for geom, force in zip(pair, (-pull, pull), strict=True):
        body = forces.bodies[geom]
        torque = jnp.cross(point - data.xipos[body], force)
        total = total.at[body].add(jnp.concatenate([force, torque]))
    return total
