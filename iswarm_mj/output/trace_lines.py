"""The quantities of a trial over time, as its figure and its recording show them: V, um and nN."""

from typing import NamedTuple

from iswarm_mj.output.palette import GREEN, GREY, ORANGE, PALE_GREEN, PALE_ORANGE, SKY, YELLOW

UM, NN = 1e6, 1e9
"""Micrometres per metre, nanonewtons per newton."""


class Line(NamedTuple):
    """A quantity of a trace."""

    name: str
    """Of its plot and of itself, as the end of its entity."""
    field: str
    """Of the trace."""
    factor: float
    """From SI to its unit."""
    label: str
    """In the legend."""
    colour: str


LINES = (
    Line("voltage/voltage", "voltage", 1.0, "voltage", SKY),
    Line("gaps/tool", "gap_tool", UM, "tool to ball", GREEN),
    Line("gaps/plate", "gap_plate", UM, "ball to plate", ORANGE),
    Line("attraction/electrostatic", "electrostatic", NN, "electrostatic, positive to the tool", YELLOW),
    Line("attraction/tool", "adhesion_tool", NN, "adhesion to the tool", GREEN),
    Line("attraction/plate", "adhesion_plate", NN, "adhesion to the plate", ORANGE),
    Line("attraction/weight", "weight", NN, "weight", GREY),
    Line("contact/tool", "contact_tool", NN, "contact with the tool", PALE_GREEN),
    Line("contact/plate", "contact_plate", NN, "contact with the plate", PALE_ORANGE),
)
