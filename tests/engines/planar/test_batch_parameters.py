"""Kernels read their parameters from one row of words: each under its own name and of its own kind."""

import importlib.util
from dataclasses import replace

import numpy as np
import pytest
import warp as wp
from helpers_crowds import crowd
from helpers_planar import both_engines, moved, placed, rounded

from iswarm_mj.engines.planar.contact_law import ContactLaw
from iswarm_mj.engines.planar.gpu.functions import words_of
from iswarm_mj.engines.planar.plane import Kind, Plane
from iswarm_mj.engines.planar.reception import Light
from iswarm_mj.utils.units import RD

CODE = """
import warp as wp
from iswarm_mj.engines.planar.gpu.functions import kinds_in, light_in, plane_in

@wp.kernel(enable_backward=False)
def of_plane(words: wp.array(dtype=int), out: wp.array(dtype=float)):
    at = plane_in(words)
    p = at[0]
    {plane}

@wp.kernel(enable_backward=False)
def of_kinds(words: wp.array(dtype=int), out: wp.array(dtype=float)):
    at = kinds_in(words, 2)
    p = at[1]
    {kinds}

@wp.kernel(enable_backward=False)
def of_light(words: wp.array(dtype=int), out: wp.array(dtype=float)):
    at = light_in(words)
    p = at[0]
    {light}
"""
LAWS = "between_robots", "at_walls"
PLAIN = [name for name in Plane._fields if name not in LAWS]
OF_PLANE = [*PLAIN, *(f"{law}.{n}" for law in LAWS for n in ContactLaw._fields)]


def stored(names):
    return "\n    ".join(f"out[{k}] = float(p.{name})" for k, name in enumerate(names))


@pytest.fixture(scope="module")
def kernels(tmp_path_factory):
    path = tmp_path_factory.mktemp("kernels") / "kernels_of_parameters.py"
    path.write_text(CODE.format(plane=stored(OF_PLANE), kinds=stored(Kind._fields), light=stored(Light._fields)))
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def distinct(kind, first):
    """A tuple of numbers of which no two are equal."""
    return kind(*(first + k for k in range(len(kind._fields))))


def on_cpu(values, dtype):
    return wp.array(np.asarray(values), dtype=dtype, device="cpu")


def test_a_plane_is_read_by_name(kernels):
    plane = distinct(Plane, 1)._replace(between_robots=distinct(ContactLaw, 201), at_walls=distinct(ContactLaw, 301))
    out = wp.zeros(len(OF_PLANE), dtype=float, device="cpu")
    wp.launch(kernels.of_plane, 1, [on_cpu(words_of(plane), int)], [out], device="cpu")
    expected = [*(getattr(plane, name) for name in PLAIN), *plane.between_robots, *plane.at_walls]
    np.testing.assert_array_equal(out.numpy(), expected)


def test_kinds_are_read_by_name(kernels):
    out = wp.zeros(len(Kind._fields), dtype=float, device="cpu")
    words = words_of(distinct(Kind, 1), distinct(Kind, 101))
    wp.launch(kernels.of_kinds, 1, [on_cpu(words, int)], [out], device="cpu")
    np.testing.assert_array_equal(out.numpy(), distinct(Kind, 101))


@pytest.mark.parametrize("flags", [(True, False, False), (False, True, False), (False, False, True)])
def test_light_is_read_by_name(kernels, flags):
    light = distinct(Light, 1)._replace(is_power=flags[0], needs_sight=flags[1], is_regular=flags[2])
    out = wp.zeros(len(Light._fields), dtype=float, device="cpu")
    wp.launch(kernels.of_light, 1, [on_cpu(words_of(light), int)], [out], device="cpu")
    np.testing.assert_array_equal(out.numpy(), [float(number) for number in light])


def softer(spec):
    """Robots of another softness than walls: no number of one law is that of the other."""
    for geom in spec.geoms:
        if geom.name.endswith("hull"):
            geom.solref, geom.solimp = [0.5, 1.3], [0.6, 0.97, 0.3, 0.3, 3.0]
            geom.solmix = 3.0


def test_contact_laws_of_robots_and_walls(small):
    """Each number of both laws matters: the crowd moves as with the engine for CPUs, and not so with another number."""
    engines = both_engines(small, tune=softer, tolerance=1e-5)
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
