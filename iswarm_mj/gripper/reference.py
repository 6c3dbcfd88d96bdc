"""The voltages that the paper reports (Valdastri et al. 2006, section 3.2.3)."""

PAPER_HUMIDITY = 10.0
"""Relative humidity of the paper's bands [%]."""
PAPER_GRASP = (20.0, 30.0)
"""Least voltages that lifted a touched ball, as the paper reports them [V]."""
PAPER_RELEASE = (37.0, 47.0)
"""Voltages that released a ball at a gap of 5 um, as the paper reports them [V]."""
PAPER_NO_CONTACT = 50.0
"""Below this voltage no ball was lifted without contact, as the paper reports [V]."""
