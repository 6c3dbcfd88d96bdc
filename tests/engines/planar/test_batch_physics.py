"""Physics of the planar engine for batches, with 32-bit floats: against that for CPUs. Units: mm, s."""

from dataclasses import replace
from functools import cache

import jax
import numpy as np
from helpers_crowds import crowd
from helpers_planar import both_engines, moved, placed, rounded, same_bits
from helpers_small import SMALL

from iswarm_mj.engines.planar.contact_law import ContactLaw
from iswarm_mj.utils.units import RD

EDGE = 7.5 * RD


@cache
def engine():
    """The engine for batches."""
    return both_engines(SMALL)[1]


def moves(poses, velocity, present):
    """Motion of worlds from poses at rest."""
    return moved(engine(), placed(engine(), rounded(poses), present), rounded(velocity))


def walled_crowd(n_worlds, rng, n_robots=25):
    """A crowd in the corner of the arena, of which some touch the walls."""
    poses = crowd(n_worlds, rng, n_robots)
    poses[..., :2] += EDGE - 3 * RD - 1.2
    return poses


class TestBits:
    def start(self, rng):
        start = walled_crowd(4, rng)
        present = np.arange(25) < np.array([25, 18, 25, 11])[:, None]
        return start, rng.uniform(-2, 2, start.shape), present

    def test_companions_do_not_matter(self):
        start, velocity, present = self.start(np.random.default_rng(9))
        together = moves(start, velocity, present)
        for world in range(4):
            alone = moves(start[[world]], velocity[[world]], present[[world]])
            each = (jax.tree.leaves((motion.bodies, motion.touching)) for motion in (alone, together))
            for mine, yours in zip(*each, strict=True):
                assert same_bits(mine[0], yours[world])

    def test_nor_does_the_order_in_which_worlds_begin(self):
        """Their work in the first phase decides on it; a world without contacts has none."""
        start, velocity, present = self.start(np.random.default_rng(10))
        present[1] = np.arange(25) == 3
        start[1, 3] = 0.0
        first = moves(start, velocity, present).bodies
        assert first.work[1] == 0 and (np.delete(first.work, 1) > 0).all() and len(set(first.work.tolist())) > 2
        forth = moved(engine(), first, velocity)
        back = moved(engine(), jax.tree.map(lambda a: a[::-1], first), velocity[::-1])
        each = (jax.tree.leaves((motion.bodies, motion.touching)) for motion in (forth, back))
        for one, other in zip(*each, strict=True):
            assert same_bits(one, other[::-1])


def test_worlds_that_do_not_run_keep_their_bodies():
    rng = np.random.default_rng(6)
    start = crowd(3, rng)
    velocity = rng.uniform(-1.4, 1.4, start.shape)
    before = moved(engine(), placed(engine(), start), velocity).bodies
    after, all_run = (moved(engine(), before, velocity, running=running) for running in ([True, False, True], None))
    for old, new in zip(*map(jax.tree.leaves, (before, after.bodies)), strict=True):
        np.testing.assert_array_equal(new[1], old[1])
    assert not after.touching[1].any() and after.touching[0].any()
    np.testing.assert_array_equal(after.bodies.poses[::2], all_run.bodies.poses[::2])


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
