"""Physics of the planar engine for batches (32 bits) against that for CPUs. Units: mm, s."""

from dataclasses import replace
from functools import cache

import jax
import numpy as np
import pytest
from support.crowds import crowd
from support.planar import both_engines, moved, placed, rounded, same_bits
from support.small import SMALL
from support.touching import pairs_of

from iswarm_mj.engines.base import Phase
from iswarm_mj.engines.planar.contact_law import ContactLaw
from iswarm_mj.engines.settings import REFINEMENT
from iswarm_mj.utils.units import RD

WALL = 7.5 * RD
"""Distance of the walls from the arena's centre."""
N_ROBOTS = 25
FINE = 10
"""Parts of a physics step, of runs whose robots hardly overlap."""
CLOSE = 0.02
"""How far MJX's positions at the end of a control step may be from those of MuJoCo in C."""


def long_hulls(spec):
    for geom in spec.geoms:
        if geom.name.endswith("hull"):
            geom.size[:2] = 1.3, 0.7


@cache
def engines(refinement=REFINEMENT, tune=None):
    return both_engines(SMALL, refinement, tune)


def move_both(
    poses,
    velocity,
    *,
    refinement=REFINEMENT,
    tune=None,
    present=None,
    n_substeps=10,
    running=None,
):
    """Return the motions of both engines from the same poses at rest."""
    motions = []
    for engine in engines(refinement, tune):
        bodies = placed(engine, rounded(poses), present)
        motions.append(moved(engine, bodies, rounded(velocity), n_substeps, running))
    return motions


def move_batch(poses, velocity, present):
    """Return the motion of the engine for batches."""
    return move_both(poses, velocity, present=present)[1]


def walled_crowd(n_worlds, rng, n_robots=N_ROBOTS):
    """Return a crowd in the corner of the arena, of which some touch the walls."""
    poses = crowd(n_worlds, rng, n_robots)
    poses[..., :2] += WALL - 3 * RD - 1.2
    return poses


def arrays_of(motion):
    """Return the arrays of the bodies, and the pairs in contact."""
    return jax.tree.leaves((motion.bodies, motion.touching))


def test_crowds_end_where_those_of_the_other_engine_end():
    rng = np.random.default_rng(1)
    start = walled_crowd(3, rng)
    velocity = rng.uniform(-1.4, 1.4, start.shape)
    plain, batch = move_both(start, velocity, refinement=FINE, tune=long_hulls)
    assert not plain.fault.any()
    assert not np.any(batch.fault)
    np.testing.assert_allclose(batch.bodies.poses, plain.bodies.poses, atol=CLOSE / 20)
    np.testing.assert_array_equal(batch.touching, plain.touching)

    # Contacts there are, and they matter.
    without_contacts = start + velocity
    assert pairs_of(plain.touching).sum() > 10
    assert np.abs(plain.bodies.poses - without_contacts).max() > 0.1


def test_worlds_that_do_not_run_keep_their_bodies():
    rng = np.random.default_rng(6)
    _, engine = engines()
    start = crowd(3, rng)
    velocity = rng.uniform(-1.4, 1.4, start.shape)
    before = moved(engine, placed(engine, start), velocity).bodies
    after = moved(engine, before, velocity, running=[True, False, True])
    for old, new in zip(jax.tree.leaves(before), jax.tree.leaves(after.bodies), strict=True):
        np.testing.assert_array_equal(new[1], old[1])
    assert not after.touching[1].any()
    assert after.touching[0].any()

    # The others move as if all ran.
    all_run = moved(engine, before, velocity)
    np.testing.assert_array_equal(after.bodies.poses[::2], all_run.bodies.poses[::2])


def test_pairs_are_in_contact_that_touch_at_the_end_of_any_phase():
    """Two robots meet in the first phase and part in the second; two others the other way round."""
    start = [
        [(-1.1, 0, 0), (1.1, 0, 0), (-1.1, 6, 0), (1.1, 6, 0), (-1.1, -6, 0), (1.1, -6, 0)],
    ]
    together = np.zeros((1, 6, 3))
    together[0, :, 0] = [0.5, -0.5, -0.5, 0.5, -0.5, 0.5]
    apart = np.zeros((1, 6, 3))
    apart[0, :, 0] = [-0.5, 0.5, 1.4, -1.4, 0.0, 0.0]
    phases = [Phase(10, lambda _: together), Phase(10, lambda _: apart)]
    for engine in engines():
        motion = engine.move(placed(engine, start), phases, np.ones(1, bool))
        assert np.argwhere(pairs_of(motion.touching[0])).tolist() == [[0, 1], [2, 3]]


class TestBits:
    def start(self, rng):
        """Return poses, velocities, and which robots are present, of four worlds."""
        poses = walled_crowd(4, rng)
        n_present = np.array([25, 18, 25, 11])
        present = np.arange(N_ROBOTS) < n_present[:, None]
        return poses, rng.uniform(-2, 2, poses.shape), present

    def test_the_other_worlds_of_a_batch_do_not_matter(self):
        start, velocity, present = self.start(np.random.default_rng(9))
        together = move_batch(start, velocity, present)
        for world in range(4):
            alone = move_batch(start[[world]], velocity[[world]], present[[world]])
            for of_world, of_batch in zip(arrays_of(alone), arrays_of(together), strict=True):
                assert same_bits(of_world[0], of_batch[world])

    def test_nor_does_the_order_in_which_worlds_begin(self):
        """Their work in the first phase decides on it; a world without contacts has none."""
        start, velocity, present = self.start(np.random.default_rng(10))
        present[1] = np.arange(N_ROBOTS) == 3
        start[1, 3] = 0.0
        _, engine = engines()
        first = moved(engine, placed(engine, rounded(start), present), velocity).bodies
        assert first.work[1] == 0
        assert (np.delete(first.work, 1) > 0).all()
        assert len(set(first.work.tolist())) > 2

        forth = moved(engine, first, velocity)
        reversed_worlds = jax.tree.map(lambda values: values[::-1], first)
        back = moved(engine, reversed_worlds, velocity[::-1])
        for in_order, reversed_order in zip(arrays_of(forth), arrays_of(back), strict=True):
            assert same_bits(in_order, reversed_order[::-1])


def softer(spec):
    """Give robots another softness than walls: no number of one law is that of the other."""
    for geom in spec.geoms:
        if geom.name.endswith("hull"):
            geom.solref = [-2.0, -4.0]
            geom.solimp = [0.6, 0.97, 0.3, 0.3, 3.0]
            geom.margin = 0.1
            geom.solmix = 3.0


class TestContactLaws:
    """Each number of both laws matters to a crowd."""

    @pytest.fixture(scope="class")
    @classmethod
    def motions(cls):
        """Return both engines, the start, the velocity, and where the engine for CPUs ends."""
        plain, batch = both_engines(SMALL, tune=softer, tolerance=1e-5)
        rng = np.random.default_rng(1)
        start = crowd(2, rng)
        start[1, :, :2] += plain.plane.half_extent - 3 * RD - 1.0
        start = rounded(start)
        velocity = rounded(rng.uniform(-1.4, 1.4, start.shape))
        return batch, start, velocity, cls.ends(plain, start, velocity)

    @staticmethod
    def ends(engine, start, velocity):
        return moved(engine, placed(engine, start), velocity, 20).bodies.poses

    def test_both_engines_end_at_the_same_poses(self, motions):
        batch, start, velocity, expected = motions
        assert not set(batch.plane.law_of_bodies) & set(batch.plane.law_of_solids)
        np.testing.assert_allclose(self.ends(batch, start, velocity), expected, atol=2e-5)

    @pytest.mark.parametrize("law_name", ["law_of_bodies", "law_of_solids"])
    @pytest.mark.parametrize("number", ContactLaw._fields)
    def test_with_another_number_they_do_not(self, motions, law_name, number):
        batch, start, velocity, expected = motions
        law = getattr(batch.plane, law_name)
        changed = law._replace(**{number: 0.9 * getattr(law, number)})
        changed_batch = replace(batch, plane=batch.plane._replace(**{law_name: changed}))
        assert np.abs(self.ends(changed_batch, start, velocity) - expected).max() > 1e-4
