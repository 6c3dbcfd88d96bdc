"""Effect of humidity on adhesion. Relative humidity is a percentage everywhere, 0 to 100."""

from iswarm_mj.utils.arrays import Quantity, array_module


def humidity_factor(relative_humidity: Quantity) -> Quantity:
    """Work of adhesion over that at 10 % RH, h = 1 + (RH - 10)/70 above 10 % and 1 + 0.04 (10 - RH) below.

    Source: empirical, after section 3.2.1 on its ref. 54: least at 10 % RH, twice that in air at 70 to 90 %.
    Valid for 5 to 90 % RH; of the lower branch only the sign is known.
    """
    xp = array_module(relative_humidity)
    above = relative_humidity - 10.0
    return 1 + xp.where(above > 0, above / 70, -0.04 * above)
