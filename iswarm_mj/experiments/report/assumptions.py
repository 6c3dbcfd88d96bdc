"""What was chosen where the paper is silent, and what was fitted: read from where the program itself keeps it."""

import ast
import inspect
import re
from dataclasses import fields
from typing import Any, NamedTuple

from iswarm_mj import config
from iswarm_mj.experiments.runner import evolution
from iswarm_mj.gripper.laws import detachment

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


def assumed() -> list[Setting]:
    """Configuration values that are neither `GIVEN` nor calibrated."""
    return [found for found in settings() if found.name not in GIVEN and "calibrated" not in found.meaning]


def settings() -> list[Setting]:
    """All configuration values with their defaults."""
    parts = {f.name: type(getattr(config.SwarmConfig(), f.name)) for f in fields(config.SwarmConfig)}
    found = []
    for part, cls in parts.items():
        defaults, meanings = cls(), _descriptions(cls)
        for f in fields(cls):
            name = f"{part}.{f.name}".replace("_", "-")
            found.append(Setting(name, str(getattr(defaults, f.name)), meanings[f.name]))
    return found


def fitted() -> list[Setting]:
    """Calibrated constants of the gripper."""
    meanings = descriptions(detachment)
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


def _descriptions(cls: type[Any]) -> dict[str, str]:
    """Docstrings below the fields of a dataclass."""
    return _documented(ast.parse(inspect.getsource(cls)).body[0])


def descriptions(module: Any) -> dict[str, str]:
    """Docstrings below the constants of a module."""
    return _documented(ast.parse(inspect.getsource(module)))


def _documented(node: Any) -> dict[str, str]:
    found = {}
    for item, following in zip(node.body, node.body[1:], strict=False):
        target = (
            item.target if isinstance(item, ast.AnnAssign) else item.targets[0] if isinstance(item, ast.Assign) else 0
        )
        text = following.value if isinstance(following, ast.Expr) else None
        if isinstance(target, ast.Name) and isinstance(text, ast.Constant) and isinstance(text.value, str):
            found[target.id] = " ".join(text.value.split())
    return found
