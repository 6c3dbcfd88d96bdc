"""Physics of the planar engine for batches, with 32-bit floats: against that for CPUs. Units: mm, s."""

from dataclasses import replace
from functools import cache

import jax
import numpy as np
from support.crowds import crowd
from support.planar import both_engines, moved, placed, rounded, same_bits
from support.small import SMALL
from support.touching import pairs_of

from iswarm_mj.engines.base import Phase
from iswarm_mj.engines.planar.contact_law import ContactLaw
from iswarm_mj.utils.units import RD

EDGE = 7.5 * RD
FINE = 10
"""Parts of a physics step, of runs whose robots hardly overlap."""
CLOSE = 0.02
"""Of positions at the end of a control step: how far MJX's may be from those of MuJoCo in C."""


def long_hulls(spec):
    for geom in spec.geoms:
        if geom.name.endswith("hull"):
            geom.size[:2] = 1.3, 0.7


@cache
def engines(refinement=1, tune=None):
    return both_engines(SMALL, refinement, tune)


def both_move(poses, velocity, *, refinement=1, tune=None, present=None, n_substeps=10, running=None):
    """Motions of both engines from the same poses at rest."""
    bodies = [placed(engine, rounded(poses), present) for engine in engines(refinement, tune)]
    pairs = zip(engines(refinement, tune), bodies, strict=True)
    return [moved(engine, one, rounded(velocity), n_substeps, running) for engine, one in pairs]


def walled_crowd(n_worlds, rng, n_robots=25):
    """A crowd in the corner of the arena, of which some touch the walls."""
    poses = crowd(n_worlds, rng, n_robots)
    poses[..., :2] += EDGE - 3 * RD - 1.2
    return poses


class TestCrowds:
    def test_they_end_where_those_of_the_other_engine_end(self):
        rng = np.random.default_rng(1)
        start = walled_crowd(3, rng)
        velocity = rng.uniform(-1.4, 1.4, start.shape)
        plain, batch = both_move(start, velocity, refinement=FINE, tune=long_hulls)
        assert not plain.fault.any() and not np.any(batch.fault)
        np.testing.assert_allclose(batch.bodies.poses, plain.bodies.poses, atol=CLOSE / 20)
        np.testing.assert_array_equal(batch.touching, plain.touching)
        assert pairs_of(plain.touching).sum() > 10 and np.abs(plain.bodies.poses - start - velocity).max() > 0.1


class TestWhoMoves:
    def test_worlds_that_do_not_run_keep_their_bodies(self):
        rng, (_, engine) = np.random.default_rng(6), engines()
        start = crowd(3, rng)
        velocity = rng.uniform(-1.4, 1.4, start.shape)
        before = moved(engine, placed(engine, start), velocity).bodies
        after = moved(engine, before, velocity, running=[True, False, True])
        for old, new in zip(*map(jax.tree.leaves, (before, after.bodies)), strict=True):
            np.testing.assert_array_equal(new[1], old[1])
        assert not after.touching[1].any() and after.touching[0].any()
        all_run = moved(engine, before, velocity)
        np.testing.assert_array_equal(after.bodies.poses[::2], all_run.bodies.poses[::2])


class TestPairsInContact:
    def test_those_at_the_end_of_any_phase(self):
        """Two robots meet in the first phase and part in the second; others the other way round; none in between."""
        start = [[(-1.1, 0, 0), (1.1, 0, 0), (-1.1, 6, 0), (1.1, 6, 0), (-1.1, -6, 0), (1.1, -6, 0)]]
        together = np.zeros((1, 6, 3))
        together[0, :, 0] = [0.5, -0.5, -0.5, 0.5, -0.5, 0.5]
        apart = np.zeros((1, 6, 3))
        apart[0, :, 0] = [-0.5, 0.5, 1.4, -1.4, 0.0, 0.0]
        phases = [Phase(10, lambda _: together), Phase(10, lambda _: apart)]
        found = [engine.move(placed(engine, start), phases, np.ones(1, bool)) for engine in engines()]
        for motion in found:
            assert np.argwhere(pairs_of(motion.touching[0])).tolist() == [[0, 1], [2, 3]]


class TestBits:
    def start(self, rng):
        start = walled_crowd(4, rng)
        present = np.arange(25) < np.array([25, 18, 25, 11])[:, None]
        return start, rng.uniform(-2, 2, start.shape), present

    def test_companions_do_not_matter(self):
        start, velocity, present = self.start(np.random.default_rng(9))
        together = both_move(start, velocity, present=present)[1]
        for world in range(4):
            alone = both_move(start[[world]], velocity[[world]], present=present[[world]])[1]
            each = (jax.tree.leaves((motion.bodies, motion.touching)) for motion in (alone, together))
            for mine, yours in zip(*each, strict=True):
                assert same_bits(mine[0], yours[world])

    def test_nor_does_the_order_in_which_worlds_begin(self):
        """Their work in the first phase decides on it; a world without contacts has none."""
        start, velocity, present = self.start(np.random.default_rng(10))
        present[1] = np.arange(25) == 3
        start[1, 3] = 0.0
        _, engine = engines()
        first = moved(engine, placed(engine, rounded(start), present), velocity).bodies
        assert first.work[1] == 0 and (np.delete(first.work, 1) > 0).all() and len(set(first.work.tolist())) > 2
        forth = moved(engine, first, velocity)
        back = moved(engine, jax.tree.map(lambda a: a[::-1], first), velocity[::-1])
        each = (jax.tree.leaves((motion.bodies, motion.touching)) for motion in (forth, back))
        for one, other in zip(*each, strict=True):
            assert same_bits(one, other[::-1])


def softer(spec):
    """Robots of another softness than walls: no number of one law is that of the other."""
    for geom in spec.geoms:
        if geom.name.endswith("hull"):
            geom.solref, geom.solimp = [0.5, 1.3], [0.6, 0.97, 0.3, 0.3, 3.0]
            geom.solmix = 3.0


def test_contact_laws_of_robots_and_walls():
    """Each number of both laws matters: the crowd moves as with the engine for CPUs, and not so with another number."""
    engines = both_engines(SMALL, tune=softer, tolerance=1e-5)
    rng = np.random.default_rng(1)
    start = crowd(2, rng)
    start[1, :, :2] += engines[0].plane.edge - 3 * RD - 1.0
    start, velocity = rounded(start), rounded(rng.uniform(-1.4, 1.4, start.shape))
    plain, batch = (moved(engine, placed(engine, start), velocity, 20).bodies.poses for engine in engines)
    np.testing.assert_allclose(batch, plain, atol=2e-5)
    plane = engines[1].plane
    assert not set(plane.between_robots) & set(plane.at_walls)
    for kind in ("between_robots", "at_walls"):
        for name in ContactLaw._fields:
            law = getattr(plane, kind)
            other = replace(
                engines[1], plane=plane._replace(**{kind: law._replace(**{name: 0.9 * getattr(law, name)})})
            )
            assert np.abs(moved(other, placed(other, start), velocity, 20).bodies.poses - plain).max() > 1e-4, name
