"""Check of a robot's file before MuJoCo parses it, so that a small file neither runs for ever nor fills the memory."""

from pathlib import Path
from xml.parsers import expat

from iswarm_mj.utils.errors import UserError

LARGEST_COUNT = 4096
"""Of any attribute that makes MuJoCo allocate memory."""
_EXPANDED = ("include", "replicate", "composite", "flexcomp", "attach", "model", "hfield")
"""Elements that stand for more than the file says."""
_COUNTS = {"texture": ("width", "height")}
_UNUSED_SIZES = ("memory", "njmax", "nconmax", "nstack")
"""Attributes of `<size>` for which a model of a robot allocates nothing."""


def check_plain(path: Path) -> None:
    """Check that an MJCF file says itself what it contains.

    Raises:
        UserError: it includes files, repeats or generates parts, declares a document type, or has a huge count.
        OSError: it cannot be opened.
        expat.ExpatError: it is not XML.
    """
    parser = expat.ParserCreate()

    def refuse(what: str) -> None:
        raise UserError(
            f"the robot's file {path} contains {what} in line {parser.CurrentLineNumber}; a robot's file contains each "
            f"part itself, without {', '.join(_EXPANDED)} and DOCTYPE: write the parts out."
        )

    def start(element: str, attributes: dict[str, str]) -> None:
        if element in _EXPANDED:
            refuse(f"<{element}>")
        counts = _COUNTS.get(element, ())
        if element == "size":
            counts = [name for name in attributes if name not in _UNUSED_SIZES]
        for name in counts:
            if not _is_small(attributes.get(name, "0")):
                raise UserError(
                    f"the robot's file {path} has {name}={attributes[name][:20]!r} in <{element}>, line "
                    f"{parser.CurrentLineNumber}; whole numbers up to {LARGEST_COUNT} are allowed: lower it."
                )

    parser.StartElementHandler = start
    parser.StartDoctypeDeclHandler = lambda *_: refuse("DOCTYPE")
    with path.open("rb") as file:
        parser.ParseFile(file)


def _is_small(count: str) -> bool:
    digits = count.strip().lstrip("+-")
    return digits.isdecimal() and len(digits) < 10 and int(digits) <= LARGEST_COUNT
