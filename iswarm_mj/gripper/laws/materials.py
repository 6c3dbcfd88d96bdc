"""Materials of ball, tool and plate: their effect on the fitted works of adhesion and on contacts.

The fitted works are those of the paper's surfaces as they were, rough and in air, and far below
those of clean ones. Another material scales them, which predicts a trend and no reliable value.
"""

from typing import Literal, NamedTuple

from iswarm_mj.utils.errors import ConfigError, closest


class Material(NamedTuple):
    """Handbook values of a material. SI units."""

    surface_energy: float
    """Surface energy gamma of the clean solid [J/m^2]."""
    density: float
    """Density [kg/m^3]."""
    young: float
    """Young's modulus [Pa]."""
    poisson: float
    """Poisson's ratio."""
    yield_pressure: float
    """Contact pressure at which it yields [Pa]: 1.6 times the yield stress, hardness / 2.8."""
    breakdown: float | None = None
    """Field that breaks its oxide [V/m]; None: no oxide, or unknown."""


Name = Literal[
    "solder",
    "gold",
    "silver",
    "copper",
    "aluminium",
    "steel",
    "tungsten",
    "silicon",
    "silica",
    "polystyrene",
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
"""Materials by name.

Solder is Sn 96.5 Ag 3.5 with the surface energy of tin; silica is its own oxide.

Source: surface energies of metals Tyson and Miller 1977, silicon {111} Gilman 1960, silica Brunauer
et al. 1956, polystyrene Wu 1982; hardness of metals Samsonov 1968; breakdown Sze 1981; density and
elasticity CRC Handbook.
"""
BALL, TOOL, PLATE = "solder", "aluminium", "steel"
"""Materials to which the works of adhesion are fitted; `bench.trial` has their moduli."""


def material(setting: str, text: str, usual: str) -> Material:
    """Return a material by its name, or one with a given surface energy.

    Args:
        setting: name of the setting, for the message.
        text: name of a material, or a surface energy [J/m^2].
        usual: name of the material from which all else is taken then.

    Raises:
        ConfigError: the text is neither.
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
        raise ConfigError(
            setting,
            text,
            f"{names}, or a surface energy between 0.001 and 10 J/m^2",
            remedy,
        )
    return MATERIALS[usual]._replace(surface_energy=energy)


def work_ratio(first: Material, second: Material, usual_first: str, usual_second: str) -> float:
    """Return the work of adhesion of two materials over that of the usual ones.

    From W = 2 (gamma_1 gamma_2)^(1/2).

    Source: Girifalco and Good 1957. Valid for surfaces that are alike but for their energies.
    """
    usual = MATERIALS[usual_first].surface_energy * MATERIALS[usual_second].surface_energy
    return (first.surface_energy * second.surface_energy / usual) ** 0.5


def reduced_modulus(first: Material, second: Material) -> float:
    """Return E* of two elastic bodies, 1 / E* = (1 - nu_1^2) / E_1 + (1 - nu_2^2) / E_2 [Pa]."""
    return 1 / sum((1 - body.poisson**2) / body.young for body in (first, second))
