"""What was chosen where the paper is silent, and what was fitted: read from where the program itself keeps it."""

import ast
import inspect
import re
from dataclasses import fields
from typing import NamedTuple

from iswarm_mj import config
from iswarm_mj.experiments.runner import evolution
from iswarm_mj.gripper.laws import detachment
from iswarm_mj.utils.docstrings import docs_of, field_docs

RULES = (
    "All robots sense the same moment and all move at once; whether they also hear and speak at once or one after the "
    "other is strategy.update-order.",
    "A robot turns on the spot, then walks straight; nothing but a contact pushes it sideways.",
    "Robots start on distinct cells of 1 rd outside the dump at random headings; their number is the density times the "
    "number of these cells, 2376, which gives the 280 and 314 robots of Table 2.",
    "The 32 bits of a message are LED number 2, priority 1, parity 1, and two vectors of 14 bits: bearing 5, range 5, "
    "hop count 4. A vector that came through more than 14 robots is not sent on.",
    "Dust or dump under a robot set its vector to zero with hop count 0; the robot's own motion turns and shifts it.",
    "A collision is a pair of robots in contact that was not in contact at the control step before.",
)
"""Rules that are not configuration values."""

GIVEN = {
    "arena.size": "Table 1",
    "arena.n-dust": "Table 1",
    "arena.ball-radius-min": "section 3.2.2",
    "arena.ball-radius-max": "section 3.2.2",
    "drive.step-length": "Table 1",
    "optics.communication-radius": "Table 1",
    "optics.led-beam-aperture": "Table 1",
    "optics.error-distance-measure": "Table 1",
    "optics.error-in-communication": "Table 1",
    "optics.p-communication-break": "Table 1",
    "gripper.relative-humidity": "section 3.2.3",
    "gripper.release-gap": "section 3.2.3",
}
"""Configuration values whose number the paper gives, and where; all others are choices, or calibrated.

Words of the paper without a number, as on the dump, give no value.
"""


class Setting(NamedTuple):
    """A configuration value or a constant."""

    name: str
    """As in the command line, such as strategy.dust-range."""
    value: str
    meaning: str


def settings() -> list[Setting]:
    """All configuration values with their defaults."""
    return [
        Setting(f"{part.name}.{name}".replace("_", "-"), str(getattr(values, name)), meaning)
        for part in fields(config.SwarmConfig)
        for values in [getattr(config.SwarmConfig(), part.name)]
        for name, meaning in field_docs(type(values)).items()
    ]


def assumed() -> list[Setting]:
    """Configuration values that are neither `GIVEN` nor calibrated."""
    return [found for found in settings() if found.name not in GIVEN and "calibrated" not in found.meaning]


def fitted() -> list[Setting]:
    """Calibrated constants of the gripper."""
    meanings = docs_of(ast.parse(inspect.getsource(detachment)).body)
    return [
        Setting(name, f"{getattr(detachment, name):g}", meaning)
        for name, meaning in meanings.items()
        if "calibrated" in meaning
    ]


def fitting() -> str:
    """Data to which the constants were fitted, and what was not fitted."""
    return " ".join((inspect.getdoc(detachment) or "").partition("\n\n")[2].split())


def operators() -> list[str]:
    """What the paper leaves open of its evolution: the items of the list in the docstring of `runner.evolution`."""
    items = re.split(r"^- ", inspect.getdoc(evolution) or "", flags=re.MULTILINE)[1:]
    return [" ".join(item.split()) for item in items]
