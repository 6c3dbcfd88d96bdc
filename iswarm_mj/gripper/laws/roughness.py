"""Adhesion of real surfaces: roughness lowers the pull-off, a preload raises it.

The calibrated works of adhesion are those of the surfaces as they were, rough ones. To predict the
effect of another roughness, set the works to those of smooth surfaces and the roughness to its
value.
"""

import math
from typing import Annotated, NamedTuple

from iswarm_mj.utils.arrays import Quantity, array_module
from iswarm_mj.utils.constraints import Above, Within

SEPARATION = 0.3e-9
"""Distance of surfaces in contact, H_0 [m]."""


class Surface(NamedTuple):
    """Properties of a contact beyond its work of adhesion, in SI units.

    The defaults change nothing.
    """

    roughness: Annotated[float, Within(0, 1e-6, "m")] = 0.0
    """Root-mean-square height [m]."""
    spacing: Annotated[float, Above(0, 1e-3, "m")] = 1e-6
    """Distance of the asperities from peak to peak [m]; a choice."""
    preload: Annotated[float, Within(0, 1e-3, "N")] = 0.0
    """Force that pressed the contact [N]."""
    hardness: Annotated[float, Above(0, 1e12, "Pa")] = 110e6
    """Hardness of the softer body, about 2.8 times the yield stress of solder [Pa]; a choice."""
    modulus: Annotated[float, Above(0, 1e13, "Pa")] = 45.5e9
    """Reduced modulus E* [Pa]."""
    hysteresis: Annotated[float, Within(0, 100)] = 0.0
    """Relative excess of the work of separation over that of approach."""


def roughness_factor(radius: Quantity, surface: Surface) -> Quantity:
    """Return the pull-off force from a rough surface over that from a smooth one, at most 1.

    It is 1 / (1 + 58.14 R rms / lambda^2) + 1 / (1 + 1.817 rms / H_0)^2: a contact with one
    asperity, and the attraction by the surface beneath it. A ball much larger than the asperities
    adheres by the first term alone, with a force that no longer depends on its radius.

    Source: Rabinovich et al. 2000. Valid for asperities that are small against the ball; otherwise
    it exceeds 1, its limit here.

    Args:
        radius: of the ball [m].
        surface: roughness rms, spacing lambda.
    """
    xp = array_module(radius)
    asperity = 1 / (1 + 58.14 * radius * surface.roughness / surface.spacing**2)
    beneath = 1 / (1 + 1.817 * surface.roughness / SEPARATION) ** 2
    return xp.minimum(1.0, asperity + beneath)


def preloaded_pull_off(work: Quantity, surface: Surface) -> Quantity:
    """Return the pull-off force of a contact that a preload flattened [N].

    F = (8 pi E* W a^3)^(1/2), with pi a^2 H = P of the preload P and the hardness H.

    Source: Maugis and Pollock 1984, a plastic contact that separates in a brittle way.
    """
    contact = (surface.preload / (math.pi * surface.hardness)) ** 0.5
    return (8 * math.pi * surface.modulus * work * contact**3) ** 0.5


def effective_work(work: Quantity, radius: Quantity, surface: Surface) -> Quantity:
    """Return the work of adhesion whose DMT force 2 pi R W a real surface has [J/m^2].

    Args:
        work: of smooth surfaces [J/m^2].
        radius: of the ball [m].
        surface: roughness, preload, hysteresis.
    """
    xp = array_module(work, radius)
    separating = work * (1 + surface.hysteresis)
    rough = separating * roughness_factor(radius, surface)
    preloaded = preloaded_pull_off(separating, surface) / (2 * math.pi * radius)
    return xp.maximum(rough, preloaded)
