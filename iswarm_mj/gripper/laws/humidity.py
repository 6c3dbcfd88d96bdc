"""Effect of humidity on adhesion: an empirical factor by default, a water meniscus as an option.

Relative humidity is a percentage everywhere, 0 to 100.
"""

from typing import Literal

from iswarm_mj.utils.arrays import Quantity, array_module
from iswarm_mj.utils.errors import UserError

GAS_CONSTANT = 8.31446
"""[J/(mol K)]"""
WATER_SURFACE_TENSION = 0.0720
"""At 25 deg C [N/m]."""
WATER_MOLAR_VOLUME = 1.8069e-5
"""At 25 deg C [m^3/mol]."""
ROUGH_GAP = 2.4e-9
"""Distance at which asperities keep the surfaces apart [m]; chosen such that the threshold lies at 65 % RH."""


def humidity_factor(relative_humidity: Quantity) -> Quantity:
    """Work of adhesion over that at 10 % RH, h = 1 + (RH - 10)/70 above 10 % and 1 + 0.04 (10 - RH) below.

    Source: empirical, after section 3.2.1 on its ref. 54: least at 10 % RH, twice that in air at 70 to 90 %.
    Valid for 5 to 90 % RH; of the lower branch only the sign is known.

    Args:
        relative_humidity: [%].

    Returns:
        h, a pure number.
    """
    xp = array_module(relative_humidity)
    above = relative_humidity - 10.0
    return 1 + xp.where(above > 0, above / 70, -0.04 * above)


def kelvin_radius(relative_humidity: Quantity, temperature: Quantity = 298.15) -> Quantity:
    """Radius of a water meniscus in equilibrium with its vapour, r_K = -gamma V_m / (R_g T ln RH).

    Source: Thomson (Lord Kelvin) 1871; 0.525 nm / -ln(RH) at 25 deg C. Valid from about 1 nm; gamma and
    V_m are those of 25 deg C.

    Args:
        relative_humidity: above 0 and below 100 [%].
        temperature: [K].

    Returns:
        Radius of curvature, positive [m].
    """
    xp = array_module(relative_humidity, temperature)
    length = WATER_SURFACE_TENSION * WATER_MOLAR_VOLUME / (GAS_CONSTANT * temperature)
    return -length / xp.log(relative_humidity / 100)


def meniscus_work(
    relative_humidity: Quantity,
    rough_gap: Quantity = ROUGH_GAP,
    contact_angle: Quantity = 0.0,
    temperature: Quantity = 298.15,
) -> Quantity:
    """Work of adhesion of a water meniscus, W = 2 gamma cos(theta) max(0, 1 - h / (2 r_K cos(theta))).

    Source: Laplace pressure gamma / r_K on the area where the gap of a sphere held at distance h is below
    2 r_K cos(theta), divided by 2 pi R. Valid for r_K << R. Sets in at a threshold and tends to the force
    4 pi R gamma cos(theta) of smooth surfaces (O'Brien and Hermann 1973) as h -> 0.

    Args:
        relative_humidity: above 0 and below 100 [%].
        rough_gap: distance h at which roughness holds the surfaces [m].
        contact_angle: of water on both surfaces, below pi/2 [rad].
        temperature: [K].

    Returns:
        Work of adhesion [J/m^2]; its force is `dmt_pull_off`.
    """
    xp = array_module(relative_humidity, rough_gap, contact_angle, temperature)
    wet = xp.cos(contact_angle)
    height = 2 * kelvin_radius(relative_humidity, temperature) * wet
    return 2 * WATER_SURFACE_TENSION * wet * xp.maximum(0.0, 1 - rough_gap / height)


def humid_work(
    work: Quantity, relative_humidity: Quantity, model: Literal["empirical", "meniscus"] = "empirical"
) -> Quantity:
    """Work of adhesion at a humidity, W h(RH), or W plus that of a meniscus on rough surfaces.

    Source and validity: `humidity_factor` and `meniscus_work`.

    Args:
        work: work of adhesion at 10 % RH [J/m^2].
        relative_humidity: [%].
        model: "empirical" rises slowly, as measured; "meniscus" has a threshold near 65 % RH.

    Returns:
        Work of adhesion [J/m^2].
    """
    if model == "empirical":
        return work * humidity_factor(relative_humidity)
    if model == "meniscus":
        return work + meniscus_work(relative_humidity)
    raise UserError(f'The humidity model {model!r} is unknown; give "empirical" or "meniscus".')
