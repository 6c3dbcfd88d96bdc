"""Landing: restitution by the laws, momentum and energy of an impact, and which balls stay."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from landing_map import landing_map

from iswarm_mj.gripper.bench.engine_mujoco import MujocoBench
from iswarm_mj.gripper.bench.model import bench_spec, layout, plugin_numbers, sized
from iswarm_mj.gripper.bench.protocol import Protocol
from iswarm_mj.gripper.bench.run_trials import hang, release, staircase
from iswarm_mj.gripper.bench.script import Ramp, ramp_voltage
from iswarm_mj.gripper.bench.trial import Contacts, Trial, draw
from iswarm_mj.gripper.contact import rebound_ratio
from iswarm_mj.gripper.laws.detachment import BALL_DENSITY, WORK_OBJECT_SUBSTRATE, WORK_TOOL_OBJECT
from iswarm_mj.gripper.laws.restitution import (
    MODULUS_PLATE,
    YIELD_PRESSURE,
    plastic_ratio,
    sticking_speed,
    yield_speed,
)
from iswarm_mj.gripper.plugin import state_index

RADIUS = 20e-6
"""Radius of the ball [m]."""
MASS = BALL_DENSITY * 4 / 3 * np.pi * RADIUS**3
"""Mass of the ball [kg]."""
STICKS = float(sticking_speed(WORK_OBJECT_SUBSTRATE, RADIUS, MODULUS_PLATE, BALL_DENSITY))
"""Speed after an elastic impact up to which the ball sticks [m/s]."""
YIELDS = float(yield_speed(YIELD_PRESSURE, MODULUS_PLATE, BALL_DENSITY))
"""Speed of an impact at which the ball yields [m/s]."""


def rebound(speed, restitution=0.0, work=WORK_OBJECT_SUBSTRATE, pressure=YIELD_PRESSURE):
    """Return the speed after an impact on the plate over that before."""
    return rebound_ratio(speed, BALL_DENSITY, RADIUS, work, restitution, pressure, MODULUS_PLATE)


def test_slow_impacts_are_elastic_and_fast_ones_lose_by_the_fourth_root():
    """The law is 1.18 (v_y / v)^(1/4) for v >> v_y.

    Source: Johnson 1985, section 11.5, in the form of Thornton and Ning.
    """
    for share in (0.5, 1.0):
        assert rebound(share * YIELDS, work=0.0) == pytest.approx(1.0)

    fast = rebound(1e3 * YIELDS, work=0.0)
    faster = rebound(16e3 * YIELDS, work=0.0)
    assert fast / faster == pytest.approx(2.0, rel=1e-3)
    assert fast == pytest.approx(1.185 * 1e3**-0.25, rel=2e-3)


def separation_energy(work, radius, modulus):
    """Return the work that tears a JKR contact apart [J], without `laws.restitution`.

    The integral of force over distance goes from d = 0, where surfaces jump into contact, to the
    least d, where they part. Source: Johnson, Kendall, Roberts 1971: for a contact of radius a,
    P = 4 E a^3 / (3 R) - (8 pi W E a^3)^(1/2) and d = a^2 / R - (2 pi W a / E)^(1/2).
    """
    cube = 2 * np.pi * work * radius**2 / modulus
    a = np.linspace(cube ** (1 / 3), (cube / 16) ** (1 / 3), 100_001)
    force = 4 * modulus * a**3 / (3 * radius) - np.sqrt(8 * np.pi * work * modulus * a**3)
    distance = a**2 / radius - np.sqrt(2 * np.pi * work * a / modulus)
    return float(((force[1:] + force[:-1]) / 2 * np.diff(distance)).sum())


SEPARATION_ENERGY = separation_energy(WORK_OBJECT_SUBSTRATE, RADIUS, MODULUS_PLATE)


def elastic(contact_radius):
    """Return force and approach of a Hertzian contact."""
    force = 4 * MODULUS_PLATE * contact_radius**3 / (3 * RADIUS)
    return force, contact_radius**2 / RADIUS


YIELDED = np.pi * RADIUS * YIELD_PRESSURE / (2 * MODULUS_PLATE)
"""Radius of the contact in whose centre the pressure is that of yield."""


def test_a_ball_yields_where_the_pressure_in_the_centre_does():
    force, approach = elastic(YIELDED)
    speed = (2 * 0.4 * force * approach / MASS) ** 0.5
    assert pytest.approx(speed, rel=1e-9) == YIELDS


@pytest.mark.parametrize("share", [0.9, 0.5, 0.1, 0.003])
def test_what_a_ball_that_yielded_gives_back(share):
    """The force rises by pi p_y R per distance beyond yield.

    It falls along the Hertzian line of a sphere of the flattened radius.
    """
    force, approach = elastic(YIELDED)
    elastic_energy = 0.4 * force * approach
    energy = elastic_energy / share**2

    # The approach beyond yield, from the energy that is left.
    slope = np.pi * YIELD_PRESSURE * RADIUS
    plastic_energy = energy - elastic_energy
    beyond_yield = 2 * plastic_energy / (force + (force**2 + 2 * slope * plastic_energy) ** 0.5)

    # What the flattened contact gives back.
    largest_force = force + slope * beyond_yield
    contact_radius = (RADIUS * (approach + beyond_yield)) ** 0.5
    flattened_radius = 4 * MODULUS_PLATE * contact_radius**3 / (3 * largest_force)
    given_back = 0.4 * largest_force * contact_radius**2 / flattened_radius
    assert plastic_ratio(share) == pytest.approx((given_back / energy) ** 0.5, rel=1e-6)


def test_the_law_is_a_jkr_contact_that_is_torn_apart():
    assert pytest.approx(MASS / 2 * STICKS**2, rel=5e-3) == SEPARATION_ENERGY


@pytest.mark.parametrize(
    ("speed", "restitution"),
    [(5.0, 0.9), (20.0, 0.3), (140.0, 0.1), (140.0, 0.3)],
)
def test_the_ball_on_the_bench_loses_what_tears_its_contact_apart(speed, restitution):
    """The loss is beyond that of the restitution without adhesion."""
    model, _, before, after = throw(speed, restitution)
    assert model.body("ball").mass[0] * 1e-9 == pytest.approx(MASS)
    loss = MASS / 2 * ((restitution * before) ** 2 - after**2) * 1e-6
    assert loss == pytest.approx(SEPARATION_ENERGY, rel=0.01)


def throw(speed, restitution=None, timestep=1e-3):
    """Throw a ball at the plate, far from the tool, without gravity.

    Args:
        speed: at the start, 2 um above the plate [um/ms].
        restitution: without adhesion; None for that of the law.
        timestep: of the physics [ms].

    Returns:
        Model and data, and the speeds before and after the impact [um/ms].
    """
    contacts = Contacts(leak=0.0, restitution=restitution)
    trial = Trial(RADIUS, WORK_TOOL_OBJECT, WORK_OBJECT_SUBSTRATE, contacts=contacts)
    spec = bench_spec()
    spec.option.timestep = timestep
    spec.option.gravity = (0, 0, 0)
    model = sized(spec, trial)
    data = mujoco.MjData(model)
    for names, value in plugin_numbers(trial).items():
        data.plugin_state[state_index(model, *names)] = value

    where = layout(model)
    height = where.ball + 2
    data.qpos[height] = 20 + 2.0
    data.qvel[height] = -speed
    data.qpos[where.slide] = 100
    data.ctrl[where.tip] = 100

    before = 0.0
    after = 0.0
    for _ in range(round(4.0 / speed / timestep) + 400):
        mujoco.mj_step(model, data)
        after = data.qvel[height]
        if after > 0:
            break
        before = -after
    return model, data, before, after


@pytest.mark.parametrize("speed", [20.0, 140.0])
def test_an_impact_follows_the_law_and_conserves_momentum(speed):
    model, data, before, after = throw(speed)
    assert after / before == pytest.approx(rebound(before * 1e-3), rel=1e-3)
    impulse = data.plugin_state[state_index(model, "adhesion_plate", "impulse")]
    assert impulse == pytest.approx(model.body("ball").mass[0] * (before + after), rel=1e-9)


def test_balls_stay_if_the_voltage_is_cut_and_fly_back_if_it_is_held_or_cut_late():
    trials = [draw(0, radius, 10.0, 0) for radius in (15e-6, 25e-6)]
    gap = 5e-6
    bench = MujocoBench(trials, gap)
    protocol = Protocol(step_voltage=2.0)
    staircase(bench, protocol, len(trials))
    hung = hang(bench, protocol, gap)
    lifted = bench.save()

    def release_by(**changes):
        bench.restore(lifted)
        return release(bench, replace(protocol, **changes), hung, gap)

    cut = release_by()
    held = release_by(after_release="held", flight_limit=1e-3)
    cut_late = release_by(cut_delay=0.9e-3, flight_limit=1e-3)
    assert cut.landed.all()
    assert not held.landed.any()
    assert not cut_late.landed.any()
    assert (held.landing_speed > cut.landing_speed).all()


def test_the_voltage_of_a_ramp_falls_after_the_delay():
    """It is 40 V after 1 ms, when the ball is seen to have left, and falls 0.2 ms later."""
    protocol = Protocol(cut_delay=0.2e-3, cut_time=0.1e-3)
    ramp = Ramp(40e3, 50.0, 1.0)
    seen = 1e-3
    times = seen + 1e-3 * np.array([-0.1, 0.0, 0.2, 0.25, 0.3, 0.5])
    volts = [ramp_voltage(protocol, ramp, seen, time) for time in times.tolist()]
    assert volts == pytest.approx([36.0, 40.0, 40.0, 20.0, 0.0, 0.0], abs=1e-9)


def test_the_map_of_sticking_is_that_of_a_contact_torn_apart():
    """A live tool pulls up whatever leaves the plate."""
    cells = landing_map((0.02, 0.15), (0.005, 0.04, 0.2))
    assert {cell.stays for cell in cells} == {True, False}
    for cell in cells:
        energy = MASS / 2 * (cell.restitution * cell.speed) ** 2
        assert cell.stays == (energy <= SEPARATION_ENERGY), cell
