"""Beams and photodiodes: hand-worked pairs, limits and symmetries, in both modes."""

import numpy as np
import pytest
from support.sensing import RADIUS, place, turned, wrapped

from iswarm_mj.config.swarm import OpticsConfig
from iswarm_mj.engines.arena import read_robot
from iswarm_mj.sensors.optics import receive

ROBOT = read_robot()
SECTOR = OpticsConfig(mode="sector")
POWER = OpticsConfig(mode="power")
HALF_EDGE = 1.0
"""Distance of LEDs and photodiodes from a robot's centre [mm]."""
SPLAY = np.radians(30)
"""Angle between each photodiode and the normal of its side [rad]."""
AHEAD = np.array([1.0, 0.0])
AT_ORIGIN = place((0, 0, 0))

both_modes = pytest.mark.parametrize("optics", [SECTOR, POWER], ids=["sector", "power"])


def receive_light(receiver, sender, optics=SECTOR, power=None):
    """Return the reception of the light from each `sender` (P, 3) at each `receiver` (P, 3)."""
    receiver, sender = np.broadcast_arrays(receiver, sender)
    dx, dy = (sender - receiver)[:, :2].T
    heading_of_receiver = np.cos(receiver[:, 2]), np.sin(receiver[:, 2])
    heading_of_sender = np.cos(sender[:, 2]), np.sin(sender[:, 2])
    return receive(dx, dy, heading_of_receiver, heading_of_sender, ROBOT, optics, power)


def sender_at(degrees, distance=5.0, off_beam=0.0):
    """Return a sender at this bearing of the origin, whose front looks `off_beam` past it [deg]."""
    angle = np.radians(degrees)
    return place((distance * np.cos(angle), distance * np.sin(angle), degrees + 180 + off_beam))


def led_of(sender):
    """Return the position of a sender's front LED."""
    return sender[0, :2] + turned(HALF_EDGE * AHEAD, sender[0, 2])


def arrives(reception):
    """Return whether the light of the first pair arrives."""
    return bool(np.isfinite(reception.effective_distance[0]))


def random_pairs(n_pairs, seed, reach=1.3):
    """Return receivers and senders up to `reach` times the range apart."""
    rng = np.random.default_rng(seed)
    receiver = np.column_stack([rng.uniform(-50, 50, (n_pairs, 2)), rng.uniform(-4, 4, n_pairs)])
    sender = np.column_stack([rng.uniform(-50, 50, (n_pairs, 2)), rng.uniform(-4, 4, n_pairs)])
    distance = rng.uniform(2.0, reach * RADIUS, n_pairs)
    bearing = rng.uniform(-4, 4, n_pairs)
    sender[:, :2] = receiver[:, :2] + turned(distance[:, None] * AHEAD, bearing)
    return receiver, sender


@both_modes
@pytest.mark.parametrize("power", [1.0, 0.5, 0.04])
def test_reach_grows_with_the_root_of_the_power(optics, power):
    """The range is from centre to centre in a sector, from LED to photodiodes by power."""
    within_robots = 2 * HALF_EDGE if optics is POWER else 0.0
    reach = within_robots + (RADIUS - within_robots) * np.sqrt(power)
    for share, is_received in ((0.999, True), (1.001, False)):
        sender = sender_at(0, reach * share)
        reception = receive_light(AT_ORIGIN, sender, optics, power=np.array([power]))
        assert arrives(reception) == is_received
    assert not arrives(receive_light(AT_ORIGIN, sender_at(0, 2.01), optics, power=np.zeros(1)))


@both_modes
@pytest.mark.parametrize("side", range(4))
@pytest.mark.parametrize("led", range(4))
def test_four_headings_and_four_sides(optics, side, led):
    sender = sender_at(90 * side, distance=6.0)
    sender[:, 2] -= led * np.pi / 2
    reception = receive_light(AT_ORIGIN, sender, optics)
    assert arrives(reception)
    assert (reception.side[0], reception.led[0]) == (side, led)
    assert wrapped(reception.bearing[0] - side * np.pi / 2) == pytest.approx(0, abs=1e-9)
    assert reception.effective_distance[0] == pytest.approx(6.0)


def test_light_goes_one_way_where_only_one_beam_is_aimed():
    aimed = place((0, 0, 0))
    shines_past = place((5, 0, 45))
    assert not arrives(receive_light(aimed, shines_past))
    assert arrives(receive_light(shines_past, aimed))


def test_range_in_a_sector_is_the_same_off_axis():
    within = sender_at(40, RADIUS - 1e-6, off_beam=25)
    beyond = sender_at(40, RADIUS + 1e-6, off_beam=25)
    assert arrives(receive_light(AT_ORIGIN, within))
    assert not arrives(receive_light(AT_ORIGIN, beyond))


@pytest.mark.parametrize(
    ("degrees", "side"),
    [(44, 0), (46, 1), (134, 1), (136, 2), (-46, 3), (-44, 0), (-136, 2)],
)
def test_sectors_meet_at_45_degrees_and_only_the_side_is_known(degrees, side):
    reception = receive_light(AT_ORIGIN, sender_at(degrees))
    assert arrives(reception)
    assert reception.side[0] == side
    assert reception.bearing[0] == pytest.approx(side * np.pi / 2)


def test_a_narrower_sector_is_blind_beyond_its_edge():
    narrow = OpticsConfig(photodiode_aperture=60)
    for inside in (29, -29, 119, 151):
        assert arrives(receive_light(AT_ORIGIN, sender_at(inside), narrow))
    for outside in (31, -31, 121, 149):
        assert not arrives(receive_light(AT_ORIGIN, sender_at(outside), narrow))


@pytest.mark.parametrize("sign", [-1, 1])
@pytest.mark.parametrize("led", range(4))
def test_a_beam_ends_30_degrees_from_its_axis(sign, led):
    for degrees, is_in_beam in ((29, True), (31, False)):
        sender = sender_at(10, off_beam=sign * degrees - 90 * led)
        reception = receive_light(AT_ORIGIN, sender)
        assert arrives(reception) is is_in_beam
        assert reception.led[0] == led


@both_modes
def test_nothing_depends_on_where_and_how_the_world_lies(optics):
    angle = 1.234
    shift = np.array([7.0, -3.0])

    def moved(poses):
        return np.column_stack([turned(poses[:, :2], angle) + shift, poses[:, 2] + angle])

    receiver, sender = random_pairs(2000, seed=2)
    before = receive_light(receiver, sender, optics)
    after = receive_light(moved(receiver), moved(sender), optics)
    for values_before, values_after in zip(before, after, strict=True):
        np.testing.assert_allclose(values_before, values_after, rtol=1e-9, atol=1e-9)


@both_modes
def test_a_mirrored_world_swaps_left_and_right(optics):
    receiver, sender = random_pairs(2000, seed=3)
    mirror = [1, -1, -1]
    before = receive_light(receiver, sender, optics)
    after = receive_light(receiver * mirror, sender * mirror, optics)

    swapped = np.array([0, 3, 2, 1])
    np.testing.assert_array_equal(after.side, swapped[before.side])
    np.testing.assert_array_equal(after.led, swapped[before.led])
    np.testing.assert_allclose(wrapped(after.bearing + before.bearing), 0, atol=1e-9)
    np.testing.assert_allclose(after.effective_distance, before.effective_distance, rtol=1e-9)


@pytest.mark.parametrize("sign", [-1, 1])
@pytest.mark.parametrize("aperture", [40.0, 60.0, 80.0])
def test_half_the_power_arrives_at_half_the_aperture(aperture, sign):
    """The sender turns about its LED, which stays on the receiver's axis, 4 mm from its side."""
    optics = OpticsConfig(mode="power", led_beam_aperture=aperture)
    gap = 4.0
    heading = np.pi + sign * np.radians(aperture / 2)
    led = (HALF_EDGE + gap) * AHEAD
    centre = led - HALF_EDGE * np.array([np.cos(heading), np.sin(heading)])
    reception = receive_light(AT_ORIGIN, np.array([[*centre, heading]]), optics)
    expected = gap * np.sqrt(2) + 2 * HALF_EDGE
    assert reception.effective_distance[0] == pytest.approx(expected, rel=1e-9)
    assert reception.bearing[0] == pytest.approx(0, abs=1e-9)


def test_received_power_against_its_formula():
    """Lobe, inverse square, mean of both photodiodes, from points and vectors in the world."""
    receiver, sender = random_pairs(500, seed=4, reach=0.9)
    reception = receive_light(receiver, sender, POWER)
    is_received = np.isfinite(reception.effective_distance)
    assert 0.1 < is_received.mean() < 1

    order = np.log(0.5) / np.log(np.cos(np.radians(30)))
    for i in np.flatnonzero(is_received):
        receiver_normal = turned(AHEAD, receiver[i, 2] + reception.side[i] * np.pi / 2)
        sender_normal = turned(AHEAD, sender[i, 2] + reception.led[i] * np.pi / 2)
        photodiodes = receiver[i, :2] + HALF_EDGE * receiver_normal
        led = sender[i, :2] + HALF_EDGE * sender_normal
        gap = np.hypot(*(led - photodiodes))
        direction = (led - photodiodes) / gap

        lobe = (-direction @ sender_normal) ** order
        left = max(direction @ turned(receiver_normal, SPLAY), 0.0)
        right = max(direction @ turned(receiver_normal, -SPLAY), 0.0)
        power = lobe * (left + right) / (2 * np.cos(SPLAY)) / gap**2
        expected = power**-0.5 + 2 * HALF_EDGE
        assert reception.effective_distance[i] == pytest.approx(expected, rel=1e-6)


def test_two_lit_photodiodes_measure_the_bearing_of_the_light_exactly():
    n_measured = 0
    for degrees in np.linspace(-40, 40, 17):
        sender = sender_at(degrees, distance=4.5)
        reception = receive_light(AT_ORIGIN, sender, POWER)
        x, y = led_of(sender)
        bearing = np.arctan2(y, x - HALF_EDGE)
        if arrives(reception) and abs(bearing) < np.radians(60):
            assert reception.bearing[0] == pytest.approx(bearing, abs=1e-9)
            n_measured += 1
    assert n_measured > 10


def test_one_lit_photodiode_measures_its_limit_only():
    """Light from over 60 degrees off the normal misses the diode that looks 30 degrees away."""
    sender = sender_at(44, distance=2.9)
    x, y = led_of(sender)
    assert np.degrees(np.arctan2(y, x - HALF_EDGE)) > 70

    reception = receive_light(AT_ORIGIN, sender, POWER)
    assert arrives(reception)
    assert reception.side[0] == 0
    assert reception.bearing[0] == pytest.approx(np.radians(60), abs=1e-9)
