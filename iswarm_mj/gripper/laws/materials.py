"""Materials of ball, tool and plate: what another one changes of the fitted works of adhesion, and of the contacts.

The fitted works are those of the paper's surfaces as they were, rough and in air, and far below those of clean ones.
Another material scales them; it predicts a trend, and no value to rely on before a fit.
"""

from typing import Literal, NamedTuple

from iswarm_mj.utils.errors import ConfigError, closest


class Material(NamedTuple):
    """Handbook values of a material. SI units."""

    surface_energy: float
    """gamma, of the clean solid [J/m^2]."""
    density: float
    """[kg/m^3]"""
    young: float
    """Young's modulus [Pa]."""
    poisson: float
    """Poisson's ratio."""
    yield_pressure: float
    """Contact pressure at which it yields, 1.6 times the yield stress, which is hardness / 2.8 [Pa]."""
    breakdown: float | None = None
    """Field that breaks its oxide [V/m]; None: it grows none, or it is unknown."""


Name = Literal[
    "solder", "gold", "silver", "copper", "aluminium", "steel", "tungsten", "silicon", "silica", "polystyrene"
]
MATERIALS: dict[str, Material] = {
    "solder": Material(0.71, 7400.0, 50e9, 0.36, 64e6),
    "gold": Material(1.51, 19300.0, 78e9, 0.44, 123e6),
    "silver": Material(1.25, 10500.0, 83e9, 0.37, 143e6),
    "copper": Material(1.79, 8960.0, 130e9, 0.34, 211e6),
    "aluminium": Material(1.14, 2700.0, 70e9, 0.34, 95e6, 1e9),
    "steel": Material(2.42, 7870.0, 200e9, 0.29, 347e6),
    "tungsten": Material(3.27, 19250.0, 411e9, 0.28, 1960e6),
    "silicon": Material(1.24, 2330.0, 169e9, 0.27, 5700e6, 1e9),
    "silica": Material(0.26, 2200.0, 72e9, 0.17, 5000e6, 1e9),
    "polystyrene": Material(0.041, 1050.0, 3.3e9, 0.34, 144e6),
}
"""By name; solder is Sn 96.5 Ag 3.5 with the surface energy of tin, silica's own oxide is itself. Surface energies:
metals Tyson and Miller 1977, silicon {111} Gilman 1960, silica Brunauer et al. 1956, polystyrene Wu 1982. Hardness of
metals: Samsonov 1968. Breakdown: Sze 1981. Density and elasticity: CRC Handbook."""
BALL, TOOL, PLATE = "solder", "aluminium", "steel"
"""To which the works of adhesion are fitted, and whose moduli are the defaults of `bench.trial`."""


def material(setting: str, text: str, usual: str) -> Material:
    """Return a material by its name, or one with a surface energy [J/m^2] and all else like another one.

    Args:
        setting: that names it, for the message.
        text: name or number.
        usual: name of the other one.

    Raises:
        ConfigError: it is neither.
    """
    if text in MATERIALS:
        return MATERIALS[text]
    try:
        energy = float(text)
    except ValueError:
        energy = -1.0
    if not 1e-3 <= energy <= 10:
        similar = closest(text, MATERIALS)
        remedy = f"perhaps you meant {similar}" if similar else None
        names = ", ".join(MATERIALS)
        raise ConfigError(setting, text, f"{names}, or a surface energy between 0.001 and 10 J/m^2", remedy)
    return MATERIALS[usual]._replace(surface_energy=energy)


def work_ratio(one: Material, other: Material, usual_one: str, usual_other: str) -> float:
    """Return the work of adhesion of two materials over that of the usual ones, from W = 2 (gamma_1 gamma_2)^(1/2).

    Source: Girifalco and Good 1957. Valid for surfaces that are alike but for their energies.
    """
    usual = MATERIALS[usual_one].surface_energy * MATERIALS[usual_other].surface_energy
    return (one.surface_energy * other.surface_energy / usual) ** 0.5


def reduced_modulus(one: Material, other: Material) -> float:
    """Return E* of two elastic bodies, 1 / E* = (1 - nu_1^2) / E_1 + (1 - nu_2^2) / E_2 [Pa]."""
    return 1 / sum((1 - body.poisson**2) / body.young for body in (one, other))
