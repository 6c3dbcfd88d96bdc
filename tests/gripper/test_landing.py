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
STICKS = float(sticking_speed(WORK_OBJECT_SUBSTRATE, RADIUS, MODULUS_PLATE, BALL_DENSITY))
YIELDS = float(yield_speed(YIELD_PRESSURE, MODULUS_PLATE, BALL_DENSITY))


def rebound(speed, restitution=0.0, work=WORK_OBJECT_SUBSTRATE, pressure=YIELD_PRESSURE):
    """Speed after an impact on the plate over that before [m/s]."""
    return rebound_ratio(speed, BALL_DENSITY, RADIUS, work, restitution, pressure, MODULUS_PLATE)


def test_slow_impacts_are_elastic_and_fast_ones_lose_by_the_fourth_root():
    assert [rebound(speed * YIELDS, work=0.0) for speed in (0.5, 1.0)] == pytest.approx([1.0, 1.0])
    fast = [rebound(speed * YIELDS, work=0.0) for speed in (1e3, 16e3)]
    assert fast[0] / fast[1] == pytest.approx(2.0, rel=1e-3)
    # For v >> v_y the law is 1.18 (v_y / v)^(1/4) (Johnson 1985, section 11.5, in the form of
    # Thornton and Ning).
    assert fast[0] == pytest.approx(1.185 * 1e3**-0.25, rel=2e-3)


def separation_energy(work, radius, modulus):
    """Work that tears a JKR contact apart [J], by integration of force over way, without
    `laws.restitution`.

    Source: Johnson, Kendall, Roberts 1971: P = 4 E a^3 / (3 R) - (8 pi W E a^3)^(1/2) and
    d = a^2 / R - (2 pi W a / E)^(1/2) for a contact of radius a, from d = 0, where surfaces jump
    into contact, to the least d, where they part.
    """
    cube = 2 * np.pi * work * radius**2 / modulus
    a = np.linspace(cube ** (1 / 3), (cube / 16) ** (1 / 3), 100_001)
    force = 4 * modulus * a**3 / (3 * radius) - np.sqrt(8 * np.pi * work * modulus * a**3)
    way = a**2 / radius - np.sqrt(2 * np.pi * work * a / modulus)
    return float(((force[1:] + force[:-1]) / 2 * np.diff(way)).sum())


MASS = BALL_DENSITY * 4 / 3 * np.pi * RADIUS**3
TORN = separation_energy(WORK_OBJECT_SUBSTRATE, RADIUS, MODULUS_PLATE)


def elastic(spot):
    """Force and approach of a Hertzian contact of this radius."""
    return 4 * MODULUS_PLATE * spot**3 / (3 * RADIUS), spot**2 / RADIUS


YIELDED = np.pi * RADIUS * YIELD_PRESSURE / (2 * MODULUS_PLATE)
"""Radius of the contact in whose centre the pressure is that of yield."""


def test_a_ball_yields_where_the_pressure_in_the_centre_does():
    force, approach = elastic(YIELDED)
    speed = (2 * 0.4 * force * approach / MASS) ** 0.5
    assert yield_speed(YIELD_PRESSURE, MODULUS_PLATE, BALL_DENSITY) == pytest.approx(
        speed,
        rel=1e-9,
    )


@pytest.mark.parametrize("share", [0.9, 0.5, 0.1, 0.003])
def test_what_a_ball_that_yielded_gives_back(share):
    """Beyond yield the force rises by pi p_y R per way; it falls along a Hertzian line of the
    flattened radius."""
    force, approach = elastic(YIELDED)
    total = 0.4 * force * approach / share**2
    slope = np.pi * YIELD_PRESSURE * RADIUS
    more = total - 0.4 * force * approach
    way = 2 * more / (force + (force**2 + 2 * slope * more) ** 0.5)
    greatest, spot = force + slope * way, (RADIUS * (approach + way)) ** 0.5
    flattened = 4 * MODULUS_PLATE * spot**3 / (3 * greatest)
    given_back = 0.4 * greatest * spot**2 / flattened
    assert plastic_ratio(share) == pytest.approx((given_back / total) ** 0.5, rel=1e-6)


def test_the_law_is_a_jkr_contact_that_is_torn_apart():
    assert pytest.approx(MASS / 2 * STICKS**2, rel=5e-3) == TORN


@pytest.mark.parametrize(
    ("speed", "restitution"),
    [(5.0, 0.9), (20.0, 0.3), (140.0, 0.1), (140.0, 0.3)],
)
def test_the_ball_on_the_bench_loses_what_tears_its_contact_apart(speed, restitution):
    """By its speeds before and after the impact, beyond what the restitution without adhesion
    takes."""
    model, _, before, after = thrown(speed, restitution)
    assert model.body("ball").mass[0] * 1e-9 == pytest.approx(MASS)
    kept = MASS / 2 * ((restitution * before) ** 2 - after**2) * 1e-6
    assert kept == pytest.approx(TORN, rel=0.01)


def thrown(speed, restitution=None, timestep=1e-3):
    """A ball thrown at the plate, far from the tool: model, data, speeds before and after
    [um/ms]."""
    trial = Trial(
        RADIUS,
        WORK_TOOL_OBJECT,
        WORK_OBJECT_SUBSTRATE,
        contacts=Contacts(leak=0.0, restitution=restitution),
    )
    spec = bench_spec()
    spec.option.timestep, spec.option.gravity = timestep, (0, 0, 0)
    model = sized(spec, trial)
    data, where = mujoco.MjData(model), layout(model)
    for names, value in plugin_numbers(trial).items():
        data.plugin_state[state_index(model, *names)] = value
    data.qpos[where.ball + 2], data.qvel[where.ball + 2] = 20 + 2.0, -speed
    data.qpos[where.slide] = data.ctrl[where.tip] = 100
    before = after = 0.0
    for _ in range(round(4.0 / speed / timestep) + 400):
        mujoco.mj_step(model, data)
        after = data.qvel[where.ball + 2]
        if after > 0:
            break
        before = -after
    return model, data, before, after


@pytest.mark.parametrize("speed", [20.0, 140.0])
def test_an_impact_follows_the_law_and_conserves_momentum(speed):
    model, data, before, after = thrown(speed)
    assert after / before == pytest.approx(rebound(before * 1e-3), rel=1e-3)
    impulse = data.plugin_state[state_index(model, "adhesion_plate", "impulse")]
    assert impulse == pytest.approx(model.body("ball").mass[0] * (before + after), rel=1e-9)


def test_balls_stay_if_the_voltage_is_cut_and_fly_back_if_it_is_held_or_cut_late():
    trials = [draw(0, radius, 10.0, 0) for radius in (15e-6, 25e-6)]
    bench, protocol = MujocoBench(trials, 5e-6), Protocol(step_voltage=2.0)
    staircase(bench, protocol, 2)
    hung, lifted = hang(bench, protocol, 5e-6), bench.save()
    found = []
    for more in (
        {},
        {"after_release": "held", "flight_limit": 1e-3},
        {"cut_delay": 0.9e-3, "flight_limit": 1e-3},
    ):
        bench.restore(lifted)
        found.append(release(bench, replace(protocol, **more), hung, 5e-6))
    cut, held, late = found
    assert cut.landed.all() and not held.landed.any() and not late.landed.any()
    assert (held.landing_speed > cut.landing_speed).all()


def test_the_voltage_of_a_ramp_falls_after_the_delay():
    """40 V when the ball was seen to have left, after 1 ms; 0.2 ms later they fall within 0.1
    ms."""
    protocol, ramp = Protocol(cut_delay=0.2e-3, cut_time=0.1e-3), Ramp(40e3, 50.0, 1.0)
    volts = [
        ramp_voltage(protocol, ramp, 1e-3, 1e-3 + after * 1e-3)
        for after in (-0.1, 0.0, 0.2, 0.25, 0.3, 0.5)
    ]
    assert volts == pytest.approx([36.0, 40.0, 40.0, 20.0, 0.0, 0.0], abs=1e-9)


def test_the_map_of_sticking_is_that_of_a_contact_torn_apart():
    """Over impact speed and restitution, under a live tool that pulls up whatever leaves the
    plate."""
    cells = landing_map((0.02, 0.15), (0.005, 0.04, 0.2))
    assert {cell.stays for cell in cells} == {True, False}
    for cell in cells:
        assert cell.stays == (MASS / 2 * (cell.restitution * cell.speed) ** 2 <= TORN), cell
