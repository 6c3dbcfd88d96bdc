"""Beams and photodiodes: hand-worked pairs, limits and symmetries, in both modes."""

import numpy as np
import pytest
from support.sensing import RADIUS, place, turned, wrapped

from iswarm_mj.config.swarm import OpticsConfig
from iswarm_mj.engines.arena import read_robot
from iswarm_mj.sensors.optics import receive

ROBOT = read_robot()
SECTOR, POWER = OpticsConfig(mode="sector"), OpticsConfig(mode="power")
both_modes = pytest.mark.parametrize("optics", [SECTOR, POWER], ids=["sector", "power"])


def light(receiver, sender, optics=SECTOR, xp=np, power=None):
    """Reception of the light from each `sender` (P, 3) at each `receiver` (P, 3)."""
    receiver, sender = (
        np.broadcast_to(p, np.broadcast_shapes(receiver.shape, sender.shape)) for p in (receiver, sender)
    )
    dx, dy = (xp.asarray(a) for a in (sender - receiver)[:, :2].T)
    views = [(xp.asarray(np.cos(p[:, 2])), xp.asarray(np.sin(p[:, 2]))) for p in (receiver, sender)]
    return receive(dx, dy, *views, ROBOT, optics, power)


def seen_at(degrees, distance=5.0, off_beam=0.0):
    """A sender at this bearing of a receiver at the origin; its front looks `off_beam` degrees past the receiver."""
    a = np.radians(degrees)
    return place((distance * np.cos(a), distance * np.sin(a), degrees + 180 + off_beam))


HERE = place((0, 0, 0))


def arrives(got):
    return bool(np.isfinite(got.effective_distance[0]))


@both_modes
@pytest.mark.parametrize("power", [1.0, 0.5, 0.04])
def test_reach_grows_with_the_root_of_the_power(optics, power):
    """In the sector from centre to centre; by power between LED and photodiodes, each 1 mm from a centre."""
    between = 2.0 if optics is POWER else 0.0
    reach = between + (RADIUS - between) * np.sqrt(power)
    for share, is_seen in ((0.999, True), (1.001, False)):
        assert arrives(light(HERE, seen_at(0, reach * share), optics, power=np.array([power]))) == is_seen
    assert not arrives(light(HERE, seen_at(0, 2.01), optics, power=np.zeros(1)))


def pairs(n, seed, reach=1.3):
    """Random receivers and senders, some out of reach."""
    rng = np.random.default_rng(seed)
    receiver, sender = (np.column_stack([rng.uniform(-50, 50, (n, 2)), rng.uniform(-4, 4, n)]) for _ in range(2))
    offset = turned(np.column_stack([rng.uniform(2.0, reach * RADIUS, n), np.zeros(n)]), rng.uniform(-4, 4, n))
    sender[:, :2] = receiver[:, :2] + offset
    return receiver, sender


@both_modes
@pytest.mark.parametrize("side", range(4))
@pytest.mark.parametrize("led", range(4))
def test_four_headings_and_four_sides(optics, side, led):
    sender = seen_at(90 * side, distance=6.0)
    sender[:, 2] -= led * np.pi / 2
    got = light(HERE, sender, optics)
    assert arrives(got)
    assert (got.side[0], got.led[0]) == (side, led)
    assert wrapped(got.bearing[0] - side * np.pi / 2) == pytest.approx(0, abs=1e-9)
    assert got.effective_distance[0] == pytest.approx(6.0)


def test_light_goes_one_way_where_only_one_beam_is_aimed():
    front, beside = place((0, 0, 0)), place((5, 0, 45))  # the second shines past the first
    assert not arrives(light(front, beside))
    assert arrives(light(beside, front))


def test_range_in_a_sector_is_the_same_off_axis():
    assert arrives(light(HERE, seen_at(40, RADIUS - 1e-6, off_beam=25)))
    assert not arrives(light(HERE, seen_at(40, RADIUS + 1e-6, off_beam=25)))


@pytest.mark.parametrize(("degrees", "side"), [(44, 0), (46, 1), (134, 1), (136, 2), (-46, 3), (-44, 0), (-136, 2)])
def test_sectors_meet_at_45_degrees_and_only_the_side_is_known(degrees, side):
    got = light(HERE, seen_at(degrees))
    assert arrives(got) and got.side[0] == side
    assert got.bearing[0] == pytest.approx(side * np.pi / 2)


def test_a_narrower_sector_is_blind_beyond_its_edge():
    narrow = OpticsConfig(photodiode_aperture=60)
    for edge in (29, -29, 119, 151):
        assert arrives(light(HERE, seen_at(edge), narrow))
    for edge in (31, -31, 121, 149):
        assert not arrives(light(HERE, seen_at(edge), narrow))


@pytest.mark.parametrize("sign", [-1, 1])
@pytest.mark.parametrize("led", range(4))
def test_a_beam_ends_30_degrees_from_its_axis(sign, led):
    for edge, ends in ((29, False), (31, True)):
        got = light(HERE, seen_at(10, off_beam=sign * edge - 90 * led))
        assert arrives(got) is not ends
        assert got.led[0] == led


@both_modes
def test_nothing_depends_on_where_and_how_the_world_lies(optics):
    receiver, sender = pairs(2000, seed=2)
    angle, shift = 1.234, np.array([7.0, -3.0])
    moved = [np.column_stack([turned(p[:, :2], angle) + shift, p[:, 2] + angle]) for p in (receiver, sender)]
    for before, after in zip(light(receiver, sender, optics), light(*moved, optics), strict=True):
        np.testing.assert_allclose(before, after, rtol=1e-9, atol=1e-9)


@both_modes
def test_a_mirrored_world_swaps_left_and_right(optics):
    receiver, sender = pairs(2000, seed=3)
    before = light(receiver, sender, optics)
    after = light(receiver * [1, -1, -1], sender * [1, -1, -1], optics)
    swapped = np.array([0, 3, 2, 1])
    np.testing.assert_array_equal(after.side, swapped[before.side])
    np.testing.assert_array_equal(after.led, swapped[before.led])
    np.testing.assert_allclose(wrapped(after.bearing + before.bearing), 0, atol=1e-9)
    np.testing.assert_allclose(after.effective_distance, before.effective_distance, rtol=1e-9)


@pytest.mark.parametrize("aperture", [40.0, 60.0, 80.0])
def test_half_the_power_arrives_at_half_the_aperture(aperture):
    """The sender's LED stays on the receiver's axis, 4 mm from its side, while the sender turns about that LED."""
    optics = OpticsConfig(mode="power", led_beam_aperture=aperture)
    for sign in (-1, 1):
        heading = np.pi + sign * np.radians(aperture / 2)
        xy = np.array([1.0 + 4.0, 0.0]) - np.array([np.cos(heading), np.sin(heading)])
        got = light(HERE, np.array([[*xy, heading]]), optics)
        assert got.effective_distance[0] == pytest.approx(4.0 * np.sqrt(2) + 2.0, rel=1e-9)
        assert got.bearing[0] == pytest.approx(0, abs=1e-9)


def test_received_power_against_its_formula():
    """Lobe, inverse square and the mean of both photodiodes, from points and vectors in the world."""
    receiver, sender = pairs(500, seed=4, reach=0.9)
    got = light(receiver, sender, POWER)
    assert 0.1 < np.isfinite(got.effective_distance).mean() < 1
    order = np.log(0.5) / np.log(np.cos(np.radians(30)))
    for i in np.flatnonzero(np.isfinite(got.effective_distance)):
        normal_r = turned(np.array([1.0, 0.0]), receiver[i, 2] + got.side[i] * np.pi / 2)
        normal_s = turned(np.array([1.0, 0.0]), sender[i, 2] + got.led[i] * np.pi / 2)
        path = (sender[i, :2] + normal_s) - (receiver[i, :2] + normal_r)
        gap = np.hypot(*path)
        lobe = (-path / gap @ normal_s) ** order
        lit = [max(path / gap @ turned(normal_r, s), 0.0) for s in np.radians([30, -30])]
        power = lobe * sum(lit) / (2 * np.cos(np.radians(30))) / gap**2
        assert got.effective_distance[i] == pytest.approx(power**-0.5 + 2.0, rel=1e-6)


def test_two_lit_photodiodes_tell_the_bearing_of_the_light_exactly():
    lit = 0
    for degrees in np.linspace(-40, 40, 17):
        sender = seen_at(degrees, distance=4.5)
        got = light(HERE, sender, POWER)
        led = sender[0, :2] + turned(np.array([1.0, 0.0]), sender[0, 2])
        bearing = np.arctan2(led[1], led[0] - 1.0)
        if arrives(got) and abs(bearing) < np.radians(60):
            assert got.bearing[0] == pytest.approx(bearing, abs=1e-9)
            lit += 1
    assert lit > 10


def test_one_lit_photodiode_tells_its_limit_only():
    """Light of a close robot from over 60 degrees off the normal misses the diode that looks 30 degrees away."""
    sender = seen_at(44, distance=2.9)
    led = sender[0, :2] + turned(np.array([1.0, 0.0]), sender[0, 2])
    assert np.degrees(np.arctan2(led[1], led[0] - 1.0)) > 70
    got = light(HERE, sender, POWER)
    assert arrives(got) and got.side[0] == 0
    assert got.bearing[0] == pytest.approx(np.radians(60), abs=1e-9)
