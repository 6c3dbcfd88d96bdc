"""Seeds and worlds of a run: what they have in common, and what they do not."""

import jax
import numpy as np
import pytest
from helpers_runs import N, end_of, records, run_of

from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.settings import RunSettings
from iswarm_mj.simulation.worlds import World
from iswarm_mj.strategy.genome import PRESETS
from iswarm_mj.utils.errors import UserError

TYPE1 = PRESETS["type1"]
ROOMY = 40


class TestSeedsAndWorlds:
    def test_a_seed_determines_all(self, small):
        one, again, other = (end_of(run_of(small, seed=seed, steps=80)) for seed in (4, 4, 5))
        np.testing.assert_array_equal(one[0], again[0])
        assert one[1] == again[1] != other[1]

    def test_robots_err_by_the_seed_too(self, small):
        """The same start with another seed soon goes another way."""
        run = run_of(small, seed=0, steps=3)
        other = run_of(small, steps=3, worlds=[World(TYPE1, N, seed=1, start=run.starts[0])])
        assert np.abs(end_of(run)[0] - end_of(other)[0]).max() > 0.1

    def test_each_world_errs_in_its_own_way(self, small):
        """Two worlds with one start soon part."""
        start = run_of(small).starts[0]
        poses, _ = end_of(run_of(small, steps=3, worlds=[World(TYPE1, N, index=w, start=start) for w in range(2)]))
        assert np.abs(poses[0] - poses[1]).max() > 0.1

    def test_empty_places_do_not_matter(self, small):
        """Not in the last bit; only the mean of all robots' speeds is a sum in another order."""
        exact, roomy = (run_of(small, n_worlds=2, steps=30, failed_fraction=0.1, capacity=c) for c in (None, ROOMY))

        def are_equal(values, roomy):
            np.testing.assert_array_equal(values, roomy[:, :N] if roomy.shape[1:2] == (ROOMY,) else roomy)

        for one, other in zip(records(exact), records(roomy), strict=True):
            np.testing.assert_allclose(one.speed, other.speed, rtol=1e-12)
            jax.tree.map(are_equal, one._replace(speed=0 * other.speed), other._replace(speed=0 * other.speed))
        assert [exact.measures(w) for w in range(2)] == [roomy.measures(w) for w in range(2)]
        assert exact.measures(1).picked > 2

    def test_too_little_capacity(self):
        with pytest.raises(UserError, match=r"capacity must be at least the number of robots \(got 29\)"):
            RunSettings(30, 5, capacity=29)

    def test_as_many_worlds_as_settings_say(self, small):
        with pytest.raises(UserError, match=r"worlds must be as many as n_worlds, 2 \(got 1\)"):
            Run(small, TYPE1, RunSettings(N, 5, n_worlds=2), worlds=[World(TYPE1, N)])
