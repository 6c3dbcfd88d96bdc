"""Attempts in the swarm: how they are counted, how they differ, how long they take, and what trials say of them."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers_attempts import any_attempts, random_attempts
from helpers_sensing import lay, place

from iswarm_mj.config import GripperConfig, SwarmConfig
from iswarm_mj.gripper.attempts import Attempts, by_balance
from iswarm_mj.gripper.bench import swarm_trials
from iswarm_mj.gripper.bench.contacts import Contacts
from iswarm_mj.gripper.bench.deciders import by_host
from iswarm_mj.gripper.bench.trial import Trial
from iswarm_mj.gripper.handling import Rules, carry, handle, working
from iswarm_mj.gripper.laws.detachment import WORK_OBJECT_SUBSTRATE, WORK_TOOL_OBJECT, grasp_voltage, is_released
from iswarm_mj.sensors.conditions import conditions_of
from iswarm_mj.sensors.floor import probe_tips, sense
from iswarm_mj.utils.units import RD

PROBE = jnp.array([0.9, 0.0])
GRIPPER = GripperConfig()


def step(gripper, balls, poses, falls=False, **kwargs):
    """One step of the hands of robots at rows of x, y, heading [deg]; whether all balls that are held fall."""
    poses = jnp.asarray(place(*poses), jnp.float32)
    tips = probe_tips(poses, PROBE)
    balls = carry(balls, tips)
    view = sense(poses, tips, balls.position, balls.is_lying, 5 * RD, 0.75 * RD)
    picks, falls = jnp.ones(len(poses), bool), jnp.full(len(balls.radius), falls)
    return handle(gripper, conditions_of(SwarmConfig(gripper=gripper)), balls, tips, view, picks, falls, **kwargs)


def test_attempts_are_counted():
    """A ball that is lifted at once, and one that two robots try for in vain, of which the nearer makes the attempt."""
    weak = replace(GRIPPER, grasp_voltage=5.0)
    balls = lay((40.9, 0), (60.9, 0))
    for _ in range(3):
        balls, failed = step(weak, balls, [(60, 0, 0), (60.95, 0.9, -90)])
    assert balls.attempts.tolist() == [0, 3] and balls.failed_grasps.tolist() == [0, 3]
    assert failed.all()
    balls, failed = step(GRIPPER, balls, [(40, 0, 0), (60, 0, 0)])
    assert balls.attempts.tolist() == [1, 4] and balls.failed_grasps.tolist() == [0, 3]
    assert balls.is_held.all() and not failed.any()


def test_a_release_in_vain_is_counted():
    balls = lay((1.0, 0.0), holders=[0])
    balls, _ = step(replace(GRIPPER, release_voltage=5.0), balls, [(0, 0, 0)])
    assert balls.failed_releases.tolist() == [1] and balls.is_held.all() and balls.attempts.tolist() == [0]


@pytest.mark.parametrize(("time", "steps"), [(0.0, 0), (0.5, 1), (2.0, 2), (2.1, 3)])
def test_an_attempt_occupies_robot_and_ball_for_its_time(time, steps):
    gripper, balls = replace(GRIPPER, grasp_time=time), lay((40.9, 0))
    where = [(40, 0, 0), (40.95, 0.9, -90)]
    for k in range(steps + 1):
        assert not balls.is_held.any()
        balls, failed = step(gripper, balls, where)
        assert working(balls, 2).tolist() == [k < steps, False]
        assert balls.attempts.tolist() == [int(k == steps)] and not failed[0]
    assert balls.is_held.all() and int(balls.holder[0]) == 0


def test_a_long_attempt_in_vain_is_told_when_it_ends():
    gripper, balls, told = replace(GRIPPER, grasp_time=2.0, grasp_voltage=5.0), lay((40.9, 0)), []
    for _ in range(3):
        balls, failed = step(gripper, balls, [(40, 0, 0)])
        told.append(bool(failed[0]))
    assert told == [False, False, True] and balls.failed_grasps.tolist() == [1]


def test_a_release_takes_its_time():
    gripper, balls = replace(GRIPPER, release_time=1.0), lay((1.0, 0.0), holders=[0])
    states = []
    for _ in range(2):
        balls, _ = step(gripper, balls, [(0, 0, 0)])
        states.append((bool(balls.is_held[0]), bool(balls.is_delivered[0]), bool(working(balls, 1)[0])))
    assert states == [(True, False, True), (False, True, False)]


def test_attempts_at_one_ball_differ_and_go_on_until_one_succeeds():
    """At the median's voltage half of the attempts succeed."""
    gripper = replace(
        GRIPPER,
        grasp_voltage=float(grasp_voltage(20e-6)),
        spot_spread_object_substrate=0.16,
        spot_spread_tool_object=0.12,
    )
    keys = jax.random.split(jax.random.key(0), 300)
    lifted = jax.vmap(lambda key: step(gripper, lay((40.9, 0)), [(40, 0, 0)], key=key)[0].is_held[0])(keys)
    assert 0.4 < lifted.mean() < 0.6


def test_an_empty_capacitor_lifts_nothing():
    for volts, holds in ((5.0, False), (50.0, True)):
        balls, _ = step(GRIPPER, lay((40.9, 0)), [(40, 0, 0)], voltage=jnp.array([volts]))
        assert bool(balls.is_held[0]) is holds


@pytest.mark.parametrize("way", [0.0, 0.19])
def test_a_tool_that_misses_lifts_nothing(way):
    """The tool's place errs by 12 um along each axis, however far it reaches [mm]; its radius is 13 um."""
    gripper = replace(GRIPPER, tool_error=12e-6)
    keys = jax.random.split(jax.random.key(1), 300)
    lifted = jax.vmap(lambda key: step(gripper, lay((40.9 + way, 0)), [(40, 0, 0)], key=key)[0].is_held[0])(keys)
    assert lifted.mean() == pytest.approx(1 - np.exp(-((13 / 12) ** 2) / 2), abs=0.07)


def test_a_lift_out_of_reach_when_it_ends_is_broken_off():
    """Neighbours push the robot away, 5 mm and then 20 mm; a fraction of a millimetre does not matter."""
    gripper = replace(GRIPPER, grasp_time=2.0)
    for places, holds in (((40, 45, 60), False), ((40, 45, 40.15), True)):
        balls = lay((40.9, 0))
        for x in places:
            balls, failed = step(gripper, balls, [(x, 0, 0)])
        assert balls.attempts.tolist() == [1] and bool(balls.is_held[0]) is holds and bool(failed[0]) is not holds
        assert (
            balls.failed_grasps.tolist() == balls.broken_off.tolist() == [int(not holds)]
            and not working(balls, 1).any()
        )
        assert balls.position[0, 0] == pytest.approx(40.9) and balls.lost_time.tolist() == [0.0 if holds else 2.0]


def test_no_trial_is_made_of_an_attempt_that_is_broken_off():
    def by_none(gripper, attempts):
        assert not (attempts.lifts | attempts.releases).any()
        return by_balance(gripper, attempts)

    gripper, rules = replace(GRIPPER, grasp_time=1.0, release_time=1.0), Rules(decider=by_none)
    for balls, places in ((lay((40.9, 0)), (40, 60)), (lay((1.0, 0.0), holders=[0]), (0, 30))):
        for x in places:
            balls, _ = step(gripper, balls, [(x, 0, 0)], rules=rules)
        assert (balls.failed_grasps + balls.failed_releases).tolist() == balls.broken_off.tolist() == [1]


def test_a_robot_pushed_off_the_dump_keeps_the_ball_that_it_releases():
    gripper, balls = replace(GRIPPER, release_time=2.0), lay((1.0, 0.0), holders=[0])
    for x in (0, 30, 60):
        balls, failed = step(gripper, balls, [(x, 0, 0)])
    assert balls.is_held.tolist() == [True] and balls.is_delivered.tolist() == [False] and not failed.any()
    assert balls.releases.tolist() == balls.failed_releases.tolist() == [1] and balls.lost_time.tolist() == [2.0]
    for _ in range(3):
        balls, _ = step(gripper, balls, [(0, 0, 0)])
    assert balls.is_delivered.tolist() == [True] and balls.releases.tolist() == [2]


def test_a_ball_that_falls_during_its_release_is_no_failed_grasp():
    gripper, balls = replace(GRIPPER, release_time=2.0), lay((1.0, 0.0), holders=[0])
    for x, falls in ((0, False), (30, False), (60, True)):
        balls, failed = step(gripper, balls, [(x, 0, 0)], falls=falls)
    assert balls.is_lying.all() and balls.failed_releases.tolist() == [1] and not failed.any()


def once_full(calls):
    """A decider that has no room when it is asked for the first time."""

    def decide(gripper, attempts):
        found, made = by_balance(gripper, attempts), attempts.lifts | attempts.releases
        if not made.any() or len(calls):
            return found
        calls.append(1)
        nothing = jnp.zeros_like(made)
        return found._replace(lifted=nothing, released=nothing, postponed=made)

    return decide


@pytest.mark.parametrize(("time", "steps"), [(0.0, 2), (3.0, 5)])
def test_a_robot_is_not_told_of_a_lack_of_room_and_tries_again_in_the_next_step(time, steps):
    gripper, rules, balls = replace(GRIPPER, grasp_time=time), Rules(decider=once_full([])), lay((40.9, 0))
    for k in range(steps):
        balls, failed = step(gripper, balls, [(40, 0, 0)], rules=rules)
        assert not failed.any() and bool(balls.is_held[0]) is (k == steps - 1)
        assert bool(working(balls, 1)[0]) is (k < steps - 1)
    assert balls.postponed.tolist() == balls.attempts.tolist() == [1] and balls.lost_time.tolist() == [1.0]


def test_a_release_without_room_is_made_in_the_next_step():
    rules, balls = Rules(decider=once_full([])), lay((1.0, 0.0), holders=[0])
    balls, _ = step(GRIPPER, balls, [(0, 0, 0)], rules=rules)
    assert balls.is_held.all() and balls.postponed.tolist() == [1] and balls.releases.tolist() == [0]
    balls, _ = step(GRIPPER, balls, [(0, 0, 0)], rules=rules)
    assert balls.is_delivered.all() and balls.releases.tolist() == [1] and balls.failed_releases.tolist() == [0]


def test_time_lost_contains_what_trials_in_vain_took():
    gripper = replace(GRIPPER, grasp_time=1.0, grasp_voltage=5.0)
    balls = lay((40.9, 0))
    for _ in range(2):
        balls, _ = step(gripper, balls, [(40, 0, 0)], rules=Rules(decider=by_host))
    assert balls.failed_grasps.tolist() == [1] and 0 < float(balls.work_time[0]) < 2e-3
    assert float(balls.lost_time[0]) == pytest.approx(1.0 + float(balls.work_time[0]), rel=1e-6)


BAND = 0.06
"""Relative distance of the voltage from the balance's threshold within which trials may decide otherwise: the charge
that a ball loses while it is lifted, and 2 um of misalignment at the tool's edge."""


EDGE = 3.1e6
"""Voltage over radius beyond which a ball may fall while the voltage is switched off, fitted to these trials: it has
some half of the voltage by then, and its acceleration towards the plate goes with the square of this [V/m]."""


def compared(attempts, decider=by_host):
    """Whether trials decide like the balance, and what both decide."""
    decide = jax.jit(lambda *arrays: (by_balance(GRIPPER, Attempts(*arrays)), decider(GRIPPER, Attempts(*arrays))))
    fast, dynamic = decide(*attempts)
    same = (fast.lifted == dynamic.lifted) & (fast.released == dynamic.released)
    return np.asarray(same), fast, dynamic


def is_clear(attempts, distance):
    """Whether attempts are away from the threshold and from the tool's edge."""
    return (np.abs(distance) > BAND) & (np.abs(attempts.misalignment - 13e-6) > 2e-6)


def agreement(count, sample, seed=0):
    """Share of random attempts below the edge and outside the bands in which trials decide like the balance, the share
    of these, and the share of clear lifts beyond the edge that fail although the balance lifts."""
    attempts, distance = sample(count, seed)
    same, fast, dynamic = compared(attempts)
    is_strong = attempts.lifts & (attempts.voltage > EDGE * attempts.radius)
    clear = is_clear(attempts, distance)
    strong = clear & is_strong
    assert not np.asarray(dynamic.lifted & ~fast.lifted)[strong].any()
    return same[clear & ~is_strong].mean(), (clear & ~is_strong).mean(), (~same[strong]).sum() / max(strong.sum(), 1)


@pytest.mark.parametrize("sample", [random_attempts, any_attempts])
def test_the_balance_is_a_surrogate_of_trials(sample):
    same, away, _ = agreement(400, sample)
    assert same >= 0.99 and away > 0.6


@pytest.mark.slow
@pytest.mark.parametrize("sample", [random_attempts, any_attempts])
def test_the_balance_is_a_surrogate_of_ten_thousand_trials(sample):
    found = [agreement(1000, sample, seed) for seed in range(10)]
    print("agreement, share of these attempts, failures beyond the edge", np.mean(found, axis=0))
    assert np.mean(found, axis=0)[0] >= 0.99


def test_strong_fields_drop_light_balls_that_charge_while_they_are_lifted():
    """By the balance all are lifted; with ten times the resistance they are."""
    radius = np.linspace(15e-6, 16.5e-6, 40)
    volts = 3.6e6 * radius
    assert by_balance(GRIPPER, lifts_of(radius, volts)).lifted.all()
    for leak, least, most in ((Contacts().leak, 0.2, 0.8), (10 * Contacts().leak, 1.0, 1.0)):
        contacts = Contacts(leak=leak)
        trials = [Trial(r, WORK_TOOL_OBJECT, WORK_OBJECT_SUBSTRATE, contacts=contacts) for r in radius]
        assert least <= swarm_trials.lift(trials, volts).succeeded.mean() <= most


def lifts_of(radius, volts):
    """Attempts to lift balls at the median works."""
    ones = np.ones_like(radius)
    works = WORK_TOOL_OBJECT * ones, WORK_OBJECT_SUBSTRATE * ones
    return Attempts(ones > 0, ones < 0, volts, radius, *works, 0 * ones)


def test_balls_that_leave_before_they_have_the_tools_voltage_return_to_the_tool():
    """With a tenth of the adhesion, not with seven tenths; the balance lets all go."""
    radius = np.linspace(15e-6, 25e-6, 30)
    for share, least, most in ((0.1, 0.4, 0.9), (0.7, 1.0, 1.0)):
        trials = [Trial(r, share * WORK_TOOL_OBJECT, WORK_OBJECT_SUBSTRATE) for r in radius]
        found = swarm_trials.drop(trials, np.full(30, 55.0), GRIPPER.release_gap)
        assert least <= found.succeeded.mean() <= most
        assert not found.impact[~found.succeeded].any()  # never down
        assert np.asarray(is_released(55.0, radius, share * WORK_TOOL_OBJECT)).all()


def test_a_ball_that_rests_as_soon_as_it_is_looked_at_needs_no_film():
    """Whose flight ended before what was filmed last."""
    found = swarm_trials.drop([Trial(21.9e-6, 0.41e-3, 14.7e-3)], np.array([62.0]), GRIPPER.release_gap)
    assert 0 < found.duration[0] < swarm_trials.RELEASE_LIMIT + swarm_trials.PROTOCOL.flight_limit


def test_a_trial_tells_how_long_it_took_and_how_fast_the_ball_landed():
    rules = Rules(decider=by_host)
    balls, _ = step(GRIPPER, lay((40.9, 0)), [(40, 0, 0)], rules=rules)
    assert balls.is_held.all() and 0.5e-3 < float(balls.work_time[0]) < 2e-3
    lifting = float(balls.work_time[0])
    balls, _ = step(GRIPPER, balls._replace(position=jnp.array([[0.9, 0.0]])), [(0, 0, 0)], rules=rules)
    assert balls.is_delivered.all() and float(balls.work_time[0]) > lifting
    assert 0.02 < float(balls.impact[0]) < 0.5


@pytest.mark.slow
def test_a_batch_in_mjx_decides_as_the_trials_in_c():
    from iswarm_mj.gripper.bench.batch_trials import by_batch

    gripper = replace(GRIPPER, bench_capacity=32)
    attempts, distance = random_attempts(32, 5)
    decide = jax.jit(lambda *arrays: (by_host(gripper, Attempts(*arrays)), by_batch(gripper, Attempts(*arrays))))
    ours, theirs = decide(*attempts)
    away = (np.abs(distance) > 0.02) & (np.abs(attempts.misalignment - 13e-6) > 2e-6)
    assert away.sum() > 20
    np.testing.assert_array_equal(np.asarray(theirs.lifted)[away], np.asarray(ours.lifted)[away])
    np.testing.assert_array_equal(np.asarray(theirs.released)[away], np.asarray(ours.released)[away])
    landed = np.asarray(ours.released & theirs.released)
    times = [np.asarray(found.duration)[landed].mean() for found in (theirs, ours)]
    assert times[0] == pytest.approx(times[1], rel=0.03)
    np.testing.assert_allclose(np.asarray(theirs.impact)[landed], np.asarray(ours.impact)[landed], rtol=0.3)


@pytest.mark.slow
def test_in_strong_fields_a_batch_in_mjx_lifts_as_many_as_c():
    """Single balls that bounce may end otherwise."""
    from iswarm_mj.gripper.bench.batch_trials import by_batch

    attempts, _ = any_attempts(4000, 11)
    strong = np.flatnonzero(attempts.lifts & (attempts.voltage > EDGE * attempts.radius))
    mine = Attempts(*(np.asarray(values)[strong] for values in attempts))
    gripper = replace(GRIPPER, bench_capacity=len(strong))
    ours, theirs = (decide(gripper, Attempts(*map(jnp.asarray, mine))).lifted for decide in (by_host, by_batch))
    print(int(ours.sum()), int(theirs.sum()), int((ours == theirs).sum()), "of", len(strong))
    assert 0.8 < float(ours.mean()) < 0.95 and float((ours == theirs).mean()) > 0.95


def test_the_bench_of_a_program_that_is_spread_over_devices_does_for_others():
    """As of one stage alone, with arrays that lie on these devices; traced, not compiled."""
    from jax.sharding import Mesh, NamedSharding, PartitionSpec

    from iswarm_mj.gripper.bench import batch_trials

    batch_trials._usual.cache_clear()
    attempts, _ = random_attempts(3, 5)
    gripper = replace(GRIPPER, bench_capacity=2)

    def lifted(*arrays):
        return batch_trials.by_batch(gripper, Attempts(*arrays)).lifted

    part = PartitionSpec()
    mesh = Mesh(np.array(jax.devices()[:1]), ("worlds",))
    spread = jax.shard_map(lifted, mesh=mesh, in_specs=(part,) * 7, out_specs=part, check_vma=False)
    placed = jax.device_put(tuple(map(jnp.asarray, attempts)), NamedSharding(mesh, part))
    for program in (spread, lifted):
        assert jax.jit(program).trace(*placed).out_info.shape == (3,)


@pytest.mark.slow
def test_a_batch_that_is_full_postpones():
    """Nothing is skipped: what finds no room is made in a later step, and counted."""
    from iswarm_mj.gripper.bench.batch_trials import by_batch

    gripper = replace(GRIPPER, bench_capacity=2)
    rules = Rules(decider=by_batch)
    balls = lay((40.9, 0), (60.9, 0), (80.9, 0))
    where = [(40, 0, 0), (60, 0, 0), (80, 0, 0)]
    held = []
    go = jax.jit(lambda balls: step(gripper, balls, where, rules=rules)[0])
    for _ in range(2):
        balls = go(balls)
        held.append((int(balls.is_held.sum()), int(balls.attempts.sum()), int(balls.postponed.sum())))
    assert held == [(2, 2, 1), (3, 3, 1)]


def test_trials_on_a_bench_that_was_used_are_those_on_a_new_one():
    """To the last bit, whatever was tried before: a lift and a release of another ball."""
    trial = Trial(17e-6, 1.5e-3, 12e-3, 10.0, misalignment=3e-6)
    volts, gap = np.array([35.0]), GRIPPER.release_gap
    swarm_trials.lift([Trial(24e-6, 1.2e-3, 16e-3)], np.array([20.0]))
    swarm_trials.drop([Trial(22e-6, 1.4e-3, 14e-3)], np.array([60.0]), gap)
    used = swarm_trials.lift([trial], volts), swarm_trials.drop([trial], volts + 20, gap)
    swarm_trials._FREE.clear()
    new = swarm_trials.lift([trial], volts)
    swarm_trials._FREE.clear()
    assert used == (new, swarm_trials.drop([trial], volts + 20, gap))
