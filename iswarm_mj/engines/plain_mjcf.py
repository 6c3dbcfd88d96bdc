"""Check of a robot's file before MuJoCo parses it.

Without it, a small file could make the parser run for ever or fill the memory.
"""

from pathlib import Path
from xml.parsers import expat

from iswarm_mj.utils.errors import UserError

LARGEST_COUNT = 4096
"""Largest value of an attribute that makes MuJoCo allocate memory."""

_EXPANDED_ELEMENTS = (
    "include",
    "replicate",
    "composite",
    "flexcomp",
    "attach",
    "model",
    "hfield",
)
"""Elements that stand for more than the file contains."""

_HARMLESS_SIZES = ("memory", "njmax", "nconmax", "nstack")
"""Attributes of `<size>` for which a model of a robot allocates nothing."""


def check_plain(path: Path) -> None:
    """Check that an MJCF file contains all parts itself, and no huge count.

    Raises:
        UserError: it includes files, repeats or generates parts, declares a document type, or has
            a huge count.
        OSError: it cannot be opened.
        expat.ExpatError: it is not XML.
    """
    parser = expat.ParserCreate()

    def check_element(element: str, attributes: dict[str, str]) -> None:
        if element in _EXPANDED_ELEMENTS:
            refuse_part(f"<{element}>")
        for name in _counts(element, attributes):
            if not _is_small(attributes[name]):
                raise UserError(
                    f"the robot's file {path} has {name}={attributes[name][:20]!r} in "
                    f"<{element}>, line {parser.CurrentLineNumber}; whole numbers up to "
                    f"{LARGEST_COUNT} are allowed: lower it."
                )

    def refuse_part(part: str) -> None:
        raise UserError(
            f"the robot's file {path} contains {part} in line {parser.CurrentLineNumber}; "
            f"a robot's file contains each part itself, without {', '.join(_EXPANDED_ELEMENTS)} "
            "and DOCTYPE: write the parts out."
        )

    parser.StartElementHandler = check_element
    parser.StartDoctypeDeclHandler = lambda *_: refuse_part("DOCTYPE")
    with path.open("rb") as file:
        parser.ParseFile(file)


def _counts(element: str, attributes: dict[str, str]) -> list[str]:
    """Return the attributes of an element for which MuJoCo allocates memory."""
    if element == "texture":
        return [name for name in ("width", "height") if name in attributes]
    if element == "size":
        return [name for name in attributes if name not in _HARMLESS_SIZES]
    return []


def _is_small(count: str) -> bool:
    """Return whether an attribute is a whole number of at most `LARGEST_COUNT`."""
    digits = count.strip().lstrip("+-")
    n_digits_of_int32 = 10  # converting longer ones takes time
    return digits.isdecimal() and len(digits) < n_digits_of_int32 and int(digits) <= LARGEST_COUNT
