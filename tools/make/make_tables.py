"""Writes the tables of docs/ that the code determines: blocks from `<!-- made: NAME -->` to `<!-- made -->`.

Run it as `python tools/make/make_tables.py`; `tests/test_site.py` checks that the pages are up to date.
"""

import re
from dataclasses import fields
from pathlib import Path
from typing import Any, get_args, get_origin, get_type_hints

from iswarm_mj.commands.options import ConfigOptions
from iswarm_mj.config.swarm import SwarmConfig
from iswarm_mj.output import rerun_entities as names
from iswarm_mj.output.memory_vectors import UNKNOWN
from iswarm_mj.output.schema import BALLS, LINKS, ROBOTS
from iswarm_mj.output.tables import TABLES, memory_columns
from iswarm_mj.strategy.declared import array_name
from iswarm_mj.strategy.genome import Genome
from iswarm_mj.strategy.interface import Command, Observation
from iswarm_mj.strategy.vector_strategy import VectorStrategy
from iswarm_mj.utils.constraints import choices, constraint_of
from iswarm_mj.utils.docstrings import field_docs
from iswarm_mj.utils.errors import FaultKind, SimulationFault
from iswarm_mj.workflows.grasp import TrialRow, units

DOCS = Path(__file__).parents[2] / "docs"
BLOCK = re.compile(r"(<!-- made: ([\w-]+) -->\n).*?(<!-- made -->)", re.DOTALL)
_UNIT = re.compile(r"\s*\[([^\]]+)\]")
FRAMES = {
    "bearing": "the robot's own",
    "ball_vector": "the robot's own",
    "payload": "the sender's, for vectors",
    "turn": "the robot's own",
    "forward": "the robot's own, along x",
}
"""Frames of what has a direction."""


def table(head: str, rows: list[tuple[Any, ...]]) -> str:
    """Return a Markdown table."""
    lines = [f"| {head} |", "|" + "---|" * (head.count("|") + 1)]
    return "\n".join(
        [*lines, *("| " + " | ".join(str(cell).replace("|", "\\|") for cell in row) + " |" for row in rows)]
    )


def columns(name: str) -> str:
    """Return the columns of a table that `iswarm_mj.load` makes, of the robots also those of the paper's strategy."""
    parts = [(array_name(part), "m" if unit else "", 1 + bool(unit)) for part, unit in VectorStrategy.recorded.items()]
    shown = TABLES[name] + (memory_columns(parts) if name == "robots" else [])
    rows = [(f"`{column.name}`", column.unit, column.description) for column, _ in shown]
    return table("column | unit | meaning", rows)


def shown(entity: str) -> list[tuple[str, str, str, str]]:
    """Return entity, component, unit and meaning of the quantities that an entity shows."""
    rows = []
    for component, _, _, column in names.SHOWN:
        if column.shown.startswith(entity):
            meaning = column.description
            if column.name == "holder":
                meaning += f", {UNKNOWN} if none does"
            rows.append((column.shown, component, names.shown_unit(column.unit), meaning))
    return rows


_ARROWS = f"{names.ARROWS}/NAME"
_AREAS = f"{names.AREAS}/NAME"
_ROBOT_CLASSES = "0 empty, 2 scout, 4 loaded; plus 1 if the robot sends priority"
_FIELD = "field of the message that is no vector, units as declared, lengths in m"
_SIDE = "side that receives: 0 front, 1 left, 2 back, 3 right"
NAMES = (
    (ROBOTS, "Boxes3D:centers", "mm", "centre of each robot; the arena is centred on the origin"),
    (ROBOTS, "Boxes3D:quaternions", "", "x, y, z, w; the robot looks along its x axis"),
    (ROBOTS, "Boxes3D:class_ids", "", _ROBOT_CLASSES),
    *shown(ROBOTS),
    (ROBOTS, "said_NAME", "", _FIELD),
    (ROBOTS, "NAME_hop", "", f"hop count of the remembered vector, {UNKNOWN} without one"),
    (ROBOTS, "NAME_hop_colour", "", "colour of the hop count, 0xRRGGBBAA"),
    (names.FRONTS, "Points3D:positions", "mm", "dot at each robot's front"),
    (BALLS, "Points3D:positions", "mm", "centre of each ball"),
    (BALLS, "Points3D:class_ids", "", "10 on the floor, 11 held, 12 delivered"),
    *shown(BALLS),
    (names.BALL_MARKERS, "Points3D:positions", "mm", "marker above the ball and the robots"),
    (names.BALL_MARKERS, "Points3D:class_ids", "", "class of the ball"),
    (names.BOXES, "Boxes3D:centers", "mm", "centre of each box that robots push"),
    (names.BOXES, "Boxes3D:half_sizes", "mm", "half edges of the box"),
    (names.BOXES, "Boxes3D:quaternions", "", "x, y, z, w"),
    (LINKS, "LineStrips3D:strips", "mm", "line from receiver to sender of each link"),
    (LINKS, "LineStrips3D:class_ids", "", "21 heard, 20 damaged message"),
    (LINKS, "receiver", "", "number of the robot that receives"),
    (LINKS, "side", "", _SIDE),
    *shown(LINKS),
    (names.TRAILS, "LineStrips3D:strips", "mm", "paths of loaded robots in the last 20 steps"),
    (names.TRAILS, "robot", "", "number of the robot of each trail"),
    (_ARROWS, "Arrows3D:origins", "mm", "points above the robots that know the vector"),
    (_ARROWS, "Arrows3D:vectors", "mm", "the vector, turned to the arena"),
    (_ARROWS, "robot", "", "number of the robot of each arrow"),
    (_AREAS, "Boxes3D:centers", "mm", "centres of areas of the task; of discs in Cylinders3D"),
    (_AREAS, "Boxes3D:half_sizes", "mm", "half edges of areas of the task"),
    (f"{names.MEMORY}/NAME", names.VALUE, "", "other recorded memory, one series a robot"),
    ("states/robot_N", "StateChange:state", "", "state from this step on; only of robots with a lane"),
    (names.COUNTS, names.VALUE, "", "robots in each state, in the order of `SeriesLines:names`"),
    (f"{names.SHARES}/NAME", names.VALUE, "", "share of the robots that know the vector"),
    *shown("series/"),
    (f"{names.METRICS}/NAME", names.VALUE, "", "a metric of the task, in its unit"),
)
"""Entity, component, unit and meaning of everything that changes in time.

What does not, such as sizes and colours, are components of the same entities without time.
"""


def recording() -> str:
    """Return the entities and components of a swarm's recording."""
    rows = [(f"`{entity}`", f"`{component}`", *more) for entity, component, *more in NAMES]
    return table("entity | component | unit | meaning", rows)


def of_arrays(cls: type) -> str:
    """Return fields of arrays: shape, unit, frame and meaning."""
    docs, rows = field_docs(cls), []
    for name, kind in get_type_hints(cls).items():
        unit = _UNIT.search(docs[name])
        shape = f"({getattr(kind, 'dim_str', 'N ...').replace(' ', ', ')})"
        kinds = {"Bool": "bool", "Float": "float", "Int": "int"}
        dtype = kinds.get(kind.__name__.split("[")[0], "") if hasattr(kind, "dim_str") else "by name"
        meaning = _UNIT.sub("", docs[name]).strip(" ,")
        rows.append((f"`{name}`", shape, dtype, unit[1] if unit else "", FRAMES.get(name, ""), meaning))
    return table("name | shape | type | unit | frame | meaning", rows)


def faults() -> str:
    """Return each kind of fault with its remedy."""
    rows = [(f"`{kind.name}`", *str(SimulationFault(kind=kind)).split("; ", 1)) for kind in FaultKind]
    return table("kind | message | remedy", rows)


def allowed(cls: type, name: str) -> str:
    """Return what values a setting may have."""
    kind, limits = get_type_hints(cls)[name], constraint_of(cls, name)
    if get_origin(kind) is tuple:
        return f"lists of {len(get_args(get_args(kind)[0]))} numbers"
    return str(limits) if limits else " or ".join(map(str, choices(cls, name))) or "true or false"


def settings() -> str:
    """Return the parameters of the configuration, a table for each group, and of the genome."""
    groups = list(get_type_hints(SwarmConfig).items())
    parts = []
    for name, cls in [*groups, ("genome", Genome)]:
        rows = []
        for f in fields(cls):
            prefix = "" if name == "genome" else f"{name}."
            is_flag = name == "genome" or name in get_type_hints(ConfigOptions)
            flag = f"--{prefix}{f.name.replace('_', '-')}" if is_flag else f"{prefix}{f.name}"
            rows.append((f"`{flag}`", f"{getattr(cls(), f.name)}", allowed(cls, f.name), field_docs(cls)[f.name]))
        title = "genome (`--genome` gives all)" if name == "genome" else name
        parts.append(f"## {title}\n\n" + table("flag | default | allowed | meaning", rows))
    return "\n\n".join(parts)


def trials() -> str:
    """Return the columns of the table of the gripper's trials."""
    docs, made = field_docs(TrialRow), units()
    rows = [(f"`{name}`", made.get(name, ""), _UNIT.sub("", docs.get(name, ""))) for name in TrialRow._fields]
    return table("column | unit | meaning", rows)


MADE = {
    "trials": trials,
    **{name: lambda name=name: columns(name) for name in TABLES},
    "Observation": lambda: of_arrays(Observation),
    "Command": lambda: of_arrays(Command),
    "recording": recording,
    "faults": faults,
    "settings": settings,
}


def filled(text: str) -> str:
    """Return the text of a page with its blocks filled in again."""
    return BLOCK.sub(lambda block: f"{block[1]}\n{MADE[block[2]]()}\n\n{block[3]}", text)


if __name__ == "__main__":
    for page in sorted(DOCS.glob("*.md")):
        text = page.read_text(encoding="utf-8")
        if (new := filled(text)) != text:
            page.write_text(new, encoding="utf-8")
            print(page)
