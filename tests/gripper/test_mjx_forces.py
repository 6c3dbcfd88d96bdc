"""The gripper's forces in MJX against the plugins, and batches of them."""

from pathlib import Path

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest
from mujoco import mjx

import iswarm_mj.gripper.mjx_forces as mjx_forces
import iswarm_mj.gripper.plugin as plugin
from iswarm_mj.gripper.mjx_forces import (
    first_state,
    gripper_forces,
)
from iswarm_mj.gripper.mjx_model import mjx_compatible, resize
from iswarm_mj.utils.errors import UserError

BENCH = Path(__file__).parents[2] / "models" / "bench.xml"
FIELDS = (
    "geom_size",
    "geom_rbound",
    "geom_aabb",
    "body_mass",
    "body_subtreemass",
    "body_inertia",
    "body_invweight0",
    "dof_invweight0",
)
SURFACES = ("adhesion_plate", "adhesion_probe")


def bench(radius=20.0):
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
    return model, gripper_forces(model), mjx.put_model(portable, impl="jax"), mjx.make_data(portable, impl="jax")


def gripper_force(forces, model, data, state):
    """Forces at positions of which nothing was computed yet."""
    return mjx_forces.gripper_force(forces, model, mjx.kinematics(model, data), state)


def random_state(random, model, data):
    """Put the ball near the plate, the probe near the ball."""
    mujoco.mj_resetData(model, data)
    radius = model.geom("ball").size[0]
    data.joint("ball").qpos = [*random.normal(0, 4, 2), radius + random.uniform(-0.5, 4), *random.normal(size=4)]
    data.joint("probe_x").qpos = random.normal(0, 8)
    data.joint("probe_z").qpos = 2 * radius - 45 + random.uniform(-0.5, 8)
    data.actuator("voltage").ctrl = random.uniform(-60, 60)
    data.plugin_state[plugin.state_index(model, "electrostatic", "potential")] = random.integers(2)


def in_mjx(dx, data):
    return dx.replace(qpos=jnp.asarray(data.qpos), qvel=jnp.asarray(data.qvel), ctrl=jnp.asarray(data.ctrl))


def ball(forces, potential):
    """State of a ball that has the potential of one electrode."""
    return first_state(forces)._replace(potential=jnp.asarray(potential, jnp.float32))


def state(model, data, instance, field):
    return data.plugin_state[plugin.state_index(model, instance, field)]


CIRCUIT = {"leak": 0.06, "contact": 1e-9, "plate_contact": 1e-4, "oxide": 0.03, "breakdown": 1000.0}
IMPACTS = {"yield_pressure": 64e3, "modulus": 45.5e6}


@pytest.mark.parametrize("circuit", [{}, CIRCUIT])
def test_forces_and_states_are_the_plugins(world, circuit):
    """A ball between plate and tool, thrown at either, at voltages below and above the breakdown, if in a circuit."""
    model, forces, mx, dx = world
    data, random, evaluate = mujoco.MjData(model), np.random.default_rng(7), jax.jit(gripper_force)
    own = {("electrostatic", name): value for name, value in circuit.items()}
    own |= {(surface, name): value for surface in SURFACES for name, value in IMPACTS.items()}
    mine, seen = forces.having({key: jnp.float32(value) for key, value in own.items()}), set()
    for _ in range(150):
        random_state(random, model, data)
        charge, before, rebound = random.normal(0, 150), random.uniform(-0.1, 0.2, 2), random.integers(0, 2, 2)
        closing = random.uniform(-100, 100, 2)
        humidity = {(surface, "humidity"): random.uniform(0, 100) for surface in SURFACES}
        values = own | humidity | {("electrostatic", "charge"): charge}
        for k, surface in enumerate(SURFACES):
            values |= {
                (surface, "before"): before[k],
                (surface, "rebound"): rebound[k],
                (surface, "closing"): closing[k],
            }
        for key, value in values.items():
            data.plugin_state[plugin.state_index(model, *key)] = value
        kept = ball(mine, state(model, data, "electrostatic", "potential"))._replace(
            charge=jnp.float32(charge),
            before=jnp.asarray(before, jnp.float32),
            rebound=jnp.asarray(rebound, jnp.float32),
            closing=jnp.asarray(closing, jnp.float32),
        )
        data.qvel[:] = 0
        mujoco.mj_forward(model, data)
        here = mine.having({key: jnp.float32(value) for key, value in humidity.items()})
        force = evaluate(here, mx, in_mjx(dx, data), kept)
        largest, generalized = np.abs(data.qfrc_passive).max(), np.zeros(model.nv)
        for body, applied in enumerate(np.asarray(force.applied, float)):
            mujoco.mj_applyFT(model, data, applied[:3], applied[3:], data.xipos[body], body, generalized)
        np.testing.assert_allclose(generalized, data.qfrc_passive, atol=1e-4 * largest)
        theirs = [state(model, data, "electrostatic", name) for name in ("force", "up", "down")]
        np.testing.assert_allclose([force.electrostatic, *force.pulls], theirs, rtol=1e-4, atol=1e-4 * largest)
        theirs = [state(model, data, "electrostatic", name) for name in ("ball_voltage", "to_probe", "to_plate")]
        np.testing.assert_allclose([force.ball_voltage, *force.capacitances], theirs, rtol=1e-4, atol=1e-3)
        near = {"gap": 1e-5, "force": 1e-4 * largest, "landing_speed": 0.01}
        for ours, (name, error) in zip((force.gaps, force.adhesion, force.landing_speed), near.items(), strict=True):
            theirs = [state(model, data, instance, name) for instance in SURFACES]
            np.testing.assert_allclose(ours, theirs, rtol=1e-4, atol=error, err_msg=name)
        seen.add(("lands", bool(force.landing_speed.any())))
        mujoco.mj_step(model, data)
        closing = [state(model, data, instance, "closing") for instance in SURFACES]
        np.testing.assert_allclose(force.state.closing, closing, rtol=1e-4, atol=0.01)
        for name in ("charge", "broken", "potential"):
            theirs = state(model, data, "electrostatic", name)
            assert getattr(force.state, name) == pytest.approx(theirs, rel=1e-3, abs=0.05), name
        rebounds = [float(state(model, data, instance, "rebound") > 0) for instance in SURFACES]
        np.testing.assert_array_equal(force.state.rebound, rebounds)
        seen |= {("broken", float(force.state.broken)), ("rebound", max(rebounds))}
    broken = {0.0, 1.0} if circuit else {0.0}
    assert seen == {
        ("lands", False),
        ("lands", True),
        ("rebound", 0.0),
        ("rebound", 1.0),
        *(("broken", value) for value in broken),
    }


@pytest.mark.parametrize("radius", [15, 25])
def test_a_resized_model_is_the_one_compiled_at_that_size(world, radius):
    _, forces, mx, _ = world
    sized, compiled = resize(forces, mx, jnp.float32(radius)), mjx_compatible(bench(radius))
    ball, dofs = forces.bodies[forces.ball], slice(0, 6)
    for name in FIELDS:
        ours, theirs = np.asarray(getattr(sized, name)), getattr(compiled, name)
        theirs = theirs.reshape(ours.shape)
        part = {"geom": forces.ball, "body": ball, "dof_": dofs}[name[:4]]
        np.testing.assert_allclose(ours[part], theirs[part], rtol=1e-5, err_msg=name)


def test_the_contact_of_a_tool_beside_the_balls_axis_is_that_of_the_cylinder(world):
    """Pressed 10 nm into the face of a tool that is shifted along x, inside and beyond the ball's axis, or its edge."""
    model, _, mx, dx = world
    data, contacts = mujoco.MjData(model), jax.jit(lambda d: mjx.collision(mx, mjx.kinematics(mx, d))._impl.contact)
    for shift in (0.0, 5.4, 9.6, 12.0, 14.0):
        beyond = max(shift - 13.0, 0.0)
        data.qpos[:7] = [0, 0, 20 - 0.01, 1, 0, 0, 0]
        data.joint("probe_x").qpos = shift
        data.joint("probe_z").qpos = 20 - 0.02 + (20**2 - beyond**2) ** 0.5 - 45
        mujoco.mj_forward(model, data)
        theirs = {tuple(sorted(c.geom)): (c.dist, abs(c.frame[:3])) for c in data.contact}
        found = contacts(in_mjx(dx, data))
        ours = {
            tuple(sorted(geoms)): (depth, abs(frame[0]))
            for geoms, depth, frame in zip(*map(np.asarray, (found.geom, found.dist, found.frame)), strict=True)
            if depth < 1
        }
        assert ours.keys() == theirs.keys() and len(ours) == 2
        for pair, (depth, normal) in theirs.items():
            assert ours[pair][0] == pytest.approx(depth, abs=1e-4)
            np.testing.assert_allclose(ours[pair][1], normal, atol=1e-3)


def test_a_model_without_the_plugin_is_refused():
    with pytest.raises(UserError, match=r"0 plugin instances of iswarm\.electrostatic; give it exactly one"):
        gripper_forces(mjx_compatible(bench()))
