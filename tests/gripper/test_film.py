"""Several moves at once, and films that are wound back, against moves one after the other; a step without attempts."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from iswarm_mj.config import GripperConfig
from iswarm_mj.gripper.attempts import Attempts
from iswarm_mj.gripper.bench import swarm_trials
from iswarm_mj.gripper.bench.base import Move
from iswarm_mj.gripper.bench.contact_log import joined
from iswarm_mj.gripper.bench.deciders import by_host
from iswarm_mj.gripper.bench.engine_mujoco import MujocoBench
from iswarm_mj.gripper.bench.trial import Trial

TRIAL, GAP = Trial(18e-6, 1.5e-3, 13e-3, misalignment=2e-6), 5e-6
RISE = Move("rise", 0.05e-3, GAP, 60.0)


def bench(is_recorded=False, hanging=GAP):
    return MujocoBench([TRIAL], 0.2e-6, 1, hanging=hanging, timestep=2e-6, is_recorded=is_recorded)


def test_several_moves_end_where_one_after_the_other_does():
    """To the last bit, and with what the last one sees at its end."""
    moves = [Move("a", 0.06e-3, -25e-9, 0.0), Move("b", 0.05e-3, -25e-9, 40.0), Move("c", 0.3e-3, 10e-9, 40.0)]
    one, all_ = bench(hanging=None), bench(hanging=None)
    there = [one.move(*move) for move in moves][-1]
    here = all_.moves(moves)
    np.testing.assert_array_equal(all_.save(), one.save())
    assert (here.gap_tool, here.gap_plate, here.speed) == (there.gap_tool, there.gap_plate, there.speed)
    assert here.finite.all() and all_.steps == one.steps


@pytest.mark.parametrize("is_recorded", [False, True])
def test_a_film_is_wound_back_to_any_of_its_steps(is_recorded):
    """It shows a ball that leaves the tool and lands, as moves do; wound back, the bench goes on as if never filmed."""
    filmed, moved = bench(is_recorded), bench(is_recorded)
    for each in (filmed, moved):
        each.moves([RISE])
    film = filmed.film("wait", 1.2e-3, GAP, 60.0)
    assert len(film.gap_tool) == len(film.states) == 600 and film.finite.all()
    assert (film.gap_plate <= 0).any() and (film.gap_plate[:200] > 4e-6).all()
    watch = moved.move("wait", 1.2e-3, GAP, 60.0)
    assert (film.gap_tool[-1], film.gap_plate[-1]) == pytest.approx((watch.gap_tool[0], watch.gap_plate[0]), rel=1e-6)
    assert film.speed[-1] == pytest.approx(watch.speed[0], rel=1e-6)
    assert film.landing_speed(599) == pytest.approx(watch.landing_speed[0], rel=1e-6)
    filmed.rewind(film, 299)
    again = filmed.film("wait", 0.6e-3, GAP, 60.0)
    np.testing.assert_array_equal(again.gap_tool, film.gap_tool[300:])
    np.testing.assert_array_equal(joined(film, again).fall[600:], film.fall[300:])


def test_a_film_of_a_bench_that_breaks_says_when():
    """A speed beyond what MuJoCo takes: the first step is wrong already, and what is wound back to it stays so."""
    broken = bench()
    broken._qvel[0, broken.where.ball] = 1e12
    film = broken.film("wait", 20e-6, GAP, 0.0)
    assert not film.finite.any()
    broken.rewind(film, 0)
    assert not broken.moves([RISE]).finite.any()


def test_a_step_without_attempts_asks_nobody(monkeypatch):
    """The same program calls the host once there is an attempt in any of its worlds, and then for all of them."""
    asked, decided = [], swarm_trials.outcomes

    def outcomes(gap, attempts):
        asked.append(attempts.lifts.sum())
        return decided(gap, attempts)

    monkeypatch.setattr(swarm_trials, "outcomes", outcomes)
    one = jnp.ones((2, 3), jnp.float32)
    decide = jax.jit(jax.vmap(lambda *arrays: by_host(GripperConfig(), Attempts(*arrays))))

    def lifted(lifts):
        nothing = jnp.zeros((2, 3), bool)
        found = decide(lifts, nothing, 40 * one, 20e-6 * one, 1.41e-3 * one, 14.7e-3 * one, 0 * one)
        return np.asarray(jax.block_until_ready(found).lifted)

    lifts = np.zeros((2, 3), bool)
    assert not lifted(lifts).any() and asked == []
    lifts[1, 2] = True
    np.testing.assert_array_equal(lifted(lifts), lifts)
    assert asked == [1]
