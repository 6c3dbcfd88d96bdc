"""The gripper's forces in MJX against the plugins, and batches of them."""

from pathlib import Path

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest
from mujoco import mjx

import iswarm_mj.gripper.plugin as plugin
from iswarm_mj.gripper import mjx_forces
from iswarm_mj.gripper.mjx_forces import first_state, gripper_forces
from iswarm_mj.gripper.mjx_model import mjx_compatible, resize
from iswarm_mj.utils.errors import UserError

BENCH = Path(__file__).parents[2] / "models" / "bench.xml"
TIP_HEIGHT = 45.0
"""Height of the tip where the probe's slide is at zero [um]."""
PROBE_RADIUS = 13.0
"""Radius of the probe [um]."""
SURFACES = ("adhesion_plate", "adhesion_probe")
"""Instances of the adhesion plugin."""
CIRCUIT = {
    "leak": 0.06,
    "contact": 1e-9,
    "plate_contact": 1e-4,
    "oxide": 0.03,
    "breakdown": 1000.0,
}
"""Attributes of an electrostatic plugin whose ball is in a circuit."""
IMPACTS = {"yield_pressure": 64e3, "modulus": 45.5e6}
"""Attributes of adhesion plugins by which impacts throw the ball back."""
SIZES = {
    "geom": ("geom_size", "geom_rbound", "geom_aabb"),
    "body": ("body_mass", "body_subtreemass", "body_inertia", "body_invweight0"),
    "dof": ("dof_invweight0",),
}
"""Fields of a model that depend on the ball's radius."""


def bench(radius=20.0):
    """Return the specification of a bench whose ball lies on the plate."""
    spec = mujoco.MjSpec.from_file(str(BENCH))
    spec.geom("ball").size[0] = radius
    spec.body("ball").pos[2] = radius
    return spec


@pytest.fixture(scope="module")
def world():
    """Model with plugins, the forces it declares, and MJX's model and data."""
    spec = bench()
    model = spec.compile()
    portable = mjx_compatible(spec)
    model_of_mjx = mjx.put_model(portable, impl="jax")
    return model, gripper_forces(model), model_of_mjx, mjx.make_data(portable, impl="jax")


@jax.jit
def gripper_force(forces, model, data, state):
    """Return the forces at positions of which nothing was computed yet."""
    return mjx_forces.gripper_force(forces, model, mjx.kinematics(model, data), state)


def in_mjx(template, data):
    """Return MJX's data with the positions, velocities and controls of MuJoCo's."""
    return template.replace(
        qpos=jnp.asarray(data.qpos),
        qvel=jnp.asarray(data.qvel),
        ctrl=jnp.asarray(data.ctrl),
    )


class Plugins:
    """Numbers of the plugins in MuJoCo's data."""

    def __init__(self, model, data):
        self.model = model
        self.data = data

    def set(self, numbers):
        """Write numbers by instance and field."""
        for (instance, field), value in numbers.items():
            index = plugin.state_index(self.model, instance, field)
            self.data.plugin_state[index] = value

    def electrostatic(self, *fields):
        """Return numbers of the electrostatic plugin."""
        return [self.number("electrostatic", field) for field in fields]

    def surfaces(self, field):
        """Return a number of each adhesion plugin."""
        return np.array([self.number(instance, field) for instance in SURFACES])

    def number(self, instance, field):
        """Return a number of an instance of a plugin."""
        return self.data.plugin_state[plugin.state_index(self.model, instance, field)]


def place_randomly(random, model, data):
    """Put the ball near the plate, and the probe near the ball."""
    mujoco.mj_resetData(model, data)
    radius = model.geom("ball").size[0]
    aside = random.normal(0, 4, 2)
    height = radius + random.uniform(-0.5, 4)
    data.joint("ball").qpos = [*aside, height, *random.normal(size=4)]
    data.joint("probe_x").qpos = random.normal(0, 8)
    data.joint("probe_z").qpos = 2 * radius - TIP_HEIGHT + random.uniform(-0.5, 8)
    data.actuator("voltage").ctrl = random.uniform(-60, 60)
    Plugins(model, data).set({("electrostatic", "potential"): random.integers(2)})


def random_state(random, forces, potential):
    """Return a state of a ball that may be charged, thrown at surfaces and thrown back."""
    charge = random.normal(0, 150)
    before = random.uniform(-0.1, 0.2, 2)
    rebound = random.integers(0, 2, 2)
    closing = random.uniform(-100, 100, 2)
    return first_state(forces)._replace(
        potential=jnp.float32(potential),
        charge=jnp.float32(charge),
        before=jnp.asarray(before, jnp.float32),
        rebound=jnp.asarray(rebound, jnp.float32),
        closing=jnp.asarray(closing, jnp.float32),
    )


def numbers_of(state):
    """Return the numbers of a state in MJX by instance and field of the plugins."""
    numbers = {("electrostatic", "charge"): float(state.charge)}
    for k, surface in enumerate(SURFACES):
        for field in ("before", "rebound", "closing"):
            numbers[surface, field] = float(getattr(state, field)[k])
    return numbers


def generalised(model, data, applied):
    """Return the generalised forces of forces and torques on the bodies (nbody, 6)."""
    generalised_force = np.zeros(model.nv)
    for body, force in enumerate(np.asarray(applied, float)):
        centre = data.xipos[body]
        mujoco.mj_applyFT(model, data, force[:3], force[3:], centre, body, generalised_force)
    return generalised_force


def check_forces(force, plugins):
    """Check that forces, gaps, voltages and capacitances are those of the plugins."""
    largest = np.abs(plugins.data.qfrc_passive).max()
    force_error = 1e-4 * largest
    np.testing.assert_allclose(
        generalised(plugins.model, plugins.data, force.applied),
        plugins.data.qfrc_passive,
        atol=force_error,
    )
    np.testing.assert_allclose(
        [force.electrostatic, *force.pulls],
        plugins.electrostatic("force", "up", "down"),
        rtol=1e-4,
        atol=force_error,
    )
    np.testing.assert_allclose(
        [force.ball_voltage, *force.capacitances],
        plugins.electrostatic("ball_voltage", "to_probe", "to_plate"),
        rtol=1e-4,
        atol=1e-3,
    )
    np.testing.assert_allclose(force.gaps, plugins.surfaces("gap"), rtol=1e-4, atol=1e-5)
    adhesion = plugins.surfaces("force")
    np.testing.assert_allclose(force.adhesion, adhesion, rtol=1e-4, atol=force_error)
    landing_speed = plugins.surfaces("landing_speed")
    np.testing.assert_allclose(force.landing_speed, landing_speed, rtol=1e-4, atol=0.01)


def check_state_after_step(state, plugins):
    """Check that the state for the next step is that of the plugins after a step."""
    np.testing.assert_allclose(state.closing, plugins.surfaces("closing"), rtol=1e-4, atol=0.01)
    for name in ("charge", "broken", "potential"):
        (expected,) = plugins.electrostatic(name)
        assert getattr(state, name) == pytest.approx(expected, rel=1e-3, abs=0.05), name
    np.testing.assert_array_equal(state.rebound, plugins.surfaces("rebound") > 0)


@pytest.mark.parametrize("circuit", [{}, CIRCUIT])
def test_forces_and_states_are_the_plugins(world, circuit):
    """Places, charges, humidities and voltages are random, below and above the breakdown.

    Among them are balls that land, that are thrown back, and whose oxide breaks in a circuit.
    """
    model, forces, mx, dx = world
    data = mujoco.MjData(model)
    plugins = Plugins(model, data)
    random = np.random.default_rng(7)

    attributes = {("electrostatic", name): value for name, value in circuit.items()}
    for surface in SURFACES:
        for name, value in IMPACTS.items():
            attributes[surface, name] = value
    forces = forces.having({place: jnp.float32(value) for place, value in attributes.items()})

    landings = set()
    rebounds = set()
    breakdowns = set()
    for _ in range(150):
        # The same state in both.
        place_randomly(random, model, data)
        (potential,) = plugins.electrostatic("potential")
        state = random_state(random, forces, potential)
        humidity = {(surface, "humidity"): random.uniform(0, 100) for surface in SURFACES}
        plugins.set(attributes | humidity | numbers_of(state))
        data.qvel[:] = 0
        mujoco.mj_forward(model, data)

        in_air = forces.having({place: jnp.float32(value) for place, value in humidity.items()})
        force = gripper_force(in_air, mx, in_mjx(dx, data), state)
        check_forces(force, plugins)
        mujoco.mj_step(model, data)
        check_state_after_step(force.state, plugins)

        landings.add(bool(force.landing_speed.any()))
        rebounds.add(bool(force.state.rebound.any()))
        breakdowns.add(bool(force.state.broken))

    assert landings == {False, True}
    assert rebounds == {False, True}
    assert breakdowns == ({False, True} if circuit else {False})


@pytest.mark.parametrize("radius", [15, 25])
def test_a_resized_model_is_the_one_compiled_at_that_size(world, radius):
    _, forces, mx, _ = world
    resized = resize(forces, mx, jnp.float32(radius))
    compiled = mjx_compatible(bench(radius))
    parts = {"geom": forces.ball, "body": forces.bodies[forces.ball], "dof": slice(0, 6)}

    for kind, names in SIZES.items():
        for name in names:
            ours = np.asarray(getattr(resized, name))
            theirs = getattr(compiled, name).reshape(ours.shape)
            part = parts[kind]
            np.testing.assert_allclose(ours[part], theirs[part], rtol=1e-5, err_msg=name)


@pytest.mark.parametrize("shift", [0.0, 5.4, 9.6, 12.0, 14.0])
def test_the_contact_of_a_tool_beside_the_balls_axis_is_that_of_the_cylinder(world, shift):
    """The ball is pressed 10 nm into tool and plate.

    The tool is shifted along x [um]: its face is above the ball's axis, or only its edge is near.
    """
    model, _, mx, dx = world
    depth = 0.01
    radius = 20.0
    beyond_edge = max(shift - PROBE_RADIUS, 0.0)
    height_of_contact = (radius**2 - beyond_edge**2) ** 0.5

    data = mujoco.MjData(model)
    data.qpos[:7] = [0, 0, radius - depth, 1, 0, 0, 0]
    data.joint("probe_x").qpos = shift
    data.joint("probe_z").qpos = radius - 2 * depth + height_of_contact - TIP_HEIGHT
    mujoco.mj_forward(model, data)

    theirs = {}
    for contact in data.contact:
        theirs[tuple(sorted(contact.geom))] = (contact.dist, abs(contact.frame[:3]))
    ours = contacts_in_mjx(mx, in_mjx(dx, data))
    assert ours.keys() == theirs.keys()
    assert len(ours) == 2
    for pair, (distance, normal) in theirs.items():
        our_distance, our_normal = ours[pair]
        assert our_distance == pytest.approx(distance, abs=1e-4)
        np.testing.assert_allclose(our_normal, normal, atol=1e-3)


@jax.jit
def collide(model, data):
    """Return the contacts that MJX finds, those far apart included.

    MJX has no public place for them.
    """
    return mjx.collision(model, mjx.kinematics(model, data))._impl.contact


def contacts_in_mjx(model, data):
    """Return distance and normal of each contact, without its sign, by the pair of geoms."""
    contacts = collide(model, data)
    pairs = np.asarray(contacts.geom)
    distances = np.asarray(contacts.dist)
    normals = np.asarray(contacts.frame)[:, 0]
    near = {}
    for pair, distance, normal in zip(pairs, distances, normals, strict=True):
        if distance < 1:
            near[tuple(sorted(pair))] = (distance, abs(normal))
    return near


def test_a_model_without_the_plugin_is_refused():
    message = r"0 plugin instances of iswarm\.electrostatic; give it exactly one"
    with pytest.raises(UserError, match=message):
        gripper_forces(mjx_compatible(bench()))
