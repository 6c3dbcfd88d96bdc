"""The voltages that the paper reports (Valdastri et al. 2006, sections 3.2.3 and 5)."""

PAPER_HUMIDITY = 10.0
"""Relative humidity of the paper's bands [%]."""
PAPER_GRASP = (20.0, 30.0)
"""Least voltages that lifted a touched ball, as the paper reports them [V]."""
PAPER_RELEASE = (37.0, 47.0)
"""Voltages that released a ball at a gap of 5 um, as the paper reports them [V]."""
PAPER_NO_CONTACT = 50.0
"""Below this voltage no ball was lifted without contact, as the paper reports [V]."""
PAPER_ON_BOARD = (20.0, 40.0)
"""Voltages that suffice to grasp and to release at 10 % RH, by section 5 [V]."""
PAPER_FIG_6 = 20.0
"""Voltage that lifted the ball of 23 um in Fig. 6 [V]."""
