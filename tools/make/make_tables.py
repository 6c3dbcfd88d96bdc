"""Write the tables of docs/ that the code determines.

    python tools/make/make_tables.py

They are blocks from `<!-- made: NAME -->` to `<!-- made -->`. `tests/test_site.py` checks that the
pages are up to date.
"""

import argparse
import json
import re
import tomllib
from collections.abc import Callable
from dataclasses import fields
from functools import partial
from pathlib import Path
from typing import Any, get_args, get_origin, get_type_hints

from iswarm_mj.commands.flags import flag
from iswarm_mj.commands.options import ConfigOptions
from iswarm_mj.config.swarm import SwarmConfig
from iswarm_mj.output import rerun_entities as names
from iswarm_mj.output.memory_vectors import UNKNOWN
from iswarm_mj.output.schema import BALLS, LINKS, ROBOTS
from iswarm_mj.output.tables import TABLES, memory_columns
from iswarm_mj.strategy.attributes import array_name
from iswarm_mj.strategy.genome import Genome
from iswarm_mj.strategy.interface import Command, Observation
from iswarm_mj.strategy.vector_strategy import VectorStrategy
from iswarm_mj.utils.constraints import choices, constraint_of
from iswarm_mj.utils.docstrings import field_docs
from iswarm_mj.utils.errors import FaultKind, SimulationFault
from iswarm_mj.workflows.grasp import TrialRow, units

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
BLOCK = re.compile(r"(<!-- made: ([\w-]+) -->\n).*?(<!-- made -->)", re.DOTALL)
_UNIT = re.compile(r"\s*\[([^\]]+)\]")
FRAMES = {
    "bearing": "the robot's own",
    "ball_vector": "the robot's own",
    "payload": "the sender's, for vectors",
    "turn": "the robot's own",
    "forward": "the robot's own, along x",
}
"""Frame of reference of each quantity that has a direction."""


def table(head: str, rows: list[tuple[Any, ...]]) -> str:
    """Return a Markdown table.

    Args:
        head: titles of the columns, with " | " between them.
        rows: cells of each row.
    """
    n_columns = head.count("|") + 1
    lines = [f"| {head} |", "|" + "---|" * n_columns]
    for row in rows:
        cells = [str(cell).replace("|", "\\|") for cell in row]
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def columns(name: str) -> str:
    """Return the columns of a table that `iswarm_mj.load` makes.

    The table of the robots also has the recorded memory of the paper's strategy.
    """
    shown_columns = list(TABLES[name])
    if name == "robots":
        parts = []
        for part, unit in VectorStrategy.recorded.items():
            is_vector = bool(unit)
            parts.append((array_name(part), "m" if is_vector else "", 2 if is_vector else 1))
        shown_columns += memory_columns(parts)
    rows = [(f"`{column.name}`", column.unit, column.description) for column, _ in shown_columns]
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
    (
        "states/robot_N",
        "StateChange:state",
        "",
        "state from this step on; only of robots with a lane",
    ),
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


_TYPE_NAMES = {"Bool": "bool", "Float": "float", "Int": "int"}
"""Names of types on pages, by the names of annotations without their number of bits."""


def of_arrays(cls: type) -> str:
    """Return the fields of a class of arrays: shape, type, unit, frame and meaning."""
    docs = field_docs(cls)
    rows = []
    for name, annotation in get_type_hints(cls).items():
        shape, dtype = shape_and_type(annotation)
        unit = _UNIT.search(docs[name])
        meaning = _UNIT.sub("", docs[name]).strip(" ,")
        frame = FRAMES.get(name, "")
        rows.append((f"`{name}`", shape, dtype, unit[1] if unit else "", frame, meaning))
    return table("name | shape | type | unit | frame | meaning", rows)


def shape_and_type(annotation: Any) -> tuple[str, str]:
    """Return shape and type of an array, or of a mapping whose arrays have types by name."""
    if not hasattr(annotation, "dim_str"):
        return "(N, ...)", "by name"
    shape = f"({annotation.dim_str.replace(' ', ', ')})"
    kind = annotation.__name__.split("[")[0]
    return shape, _TYPE_NAMES.get(kind, "")


def faults() -> str:
    """Return each kind of fault with its remedy."""
    rows = []
    for kind in FaultKind:
        message, remedy = str(SimulationFault(kind=kind)).split("; ", 1)
        rows.append((f"`{kind.name}`", message, remedy))
    return table("kind | message | remedy", rows)


def allowed(cls: type, name: str) -> str:
    """Return the values that a setting may have."""
    annotation = get_type_hints(cls)[name]
    if get_origin(annotation) is tuple:
        numbers = get_args(get_args(annotation)[0])
        return f"lists of {len(numbers)} numbers"
    limits = constraint_of(cls, name)
    if limits:
        return str(limits)
    if annotation == str | None:
        return "the name of a file"
    return " or ".join(map(str, choices(cls, name))) or "true or false"


def settings() -> str:
    """Return the parameters of the configuration, a table for each group, and of the genome."""
    groups_of_flags = get_type_hints(ConfigOptions)
    sections = []
    for group, cls in get_type_hints(SwarmConfig).items():
        if group in groups_of_flags:
            sections.append(section(group, cls, lambda name, group=group: flag(f"{group}.{name}")))
        else:
            sections.append(section(group, cls, lambda name, group=group: f"{group}.{name}"))
    sections.append(section("genome (`--genome` gives all)", Genome, flag))
    return "\n\n".join(sections)


def section(title: str, cls: type, name_of: Callable[[str], str]) -> str:
    """Return a titled table of the settings in a class.

    Args:
        title: of the table.
        cls: dataclass of settings, all of which have defaults.
        name_of: function that returns how users name a field.
    """
    docs = field_docs(cls)
    defaults = cls()
    rows = []
    for field in fields(cls):
        default = getattr(defaults, field.name)
        meaning = docs[field.name]
        rows.append((f"`{name_of(field.name)}`", default, allowed(cls, field.name), meaning))
    return f"## {title}\n\n" + table("flag | default | allowed | meaning", rows)


def trials() -> str:
    """Return the columns of the table of the gripper's trials."""
    docs = field_docs(TrialRow)
    unit_of = units()
    rows = []
    for name in TrialRow._fields:
        meaning = _UNIT.sub("", docs.get(name, ""))
        rows.append((f"`{name}`", unit_of.get(name, ""), meaning))
    return table("column | unit | meaning", rows)


def notebooks() -> str:
    """Return the table of the notebooks."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    return table_of_notebooks(project.get("urls", {}).get("Repository"))


def table_of_notebooks(address: str | None) -> str:
    """Return the table of the notebooks, with links to Colab and Binder.

    Args:
        address: address of the repository on GitHub; None without links.
    """
    rows = []
    for path in sorted((ROOT / "notebooks").glob("*.ipynb")):
        cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
        title = cells[0]["source"][0].removeprefix("# ").strip()
        file = f"notebooks/{path.name}"
        if address is None:
            rows.append((f"`{file}`", title))
        else:
            repository = address.rstrip("/").removeprefix("https://github.com/")
            colab = f"https://colab.research.google.com/github/{repository}/blob/main/{file}"
            binder = f"https://mybinder.org/v2/gh/{repository}/main?labpath={file}"
            rows.append((f"`{file}`", title, f"[Colab]({colab}), [Binder]({binder})"))
    head = "file | shows" if address is None else "file | shows | open"
    return table(head, rows)


MAKERS = {
    "notebooks": notebooks,
    "trials": trials,
    **{name: partial(columns, name) for name in TABLES},
    "Observation": partial(of_arrays, Observation),
    "Command": partial(of_arrays, Command),
    "recording": recording,
    "faults": faults,
    "settings": settings,
}
"""Functions that make the blocks of pages, by name."""


def filled(text: str) -> str:
    """Return the text of a page with its blocks made again."""
    return BLOCK.sub(lambda block: f"{block[1]}\n{MAKERS[block[2]]()}\n\n{block[3]}", text)


def main() -> None:
    """Write the pages whose blocks have changed, and print their names."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.parse_args()
    for page in sorted(DOCS.glob("*.md")):
        text = page.read_text(encoding="utf-8")
        new_text = filled(text)
        if new_text != text:
            page.write_text(new_text, encoding="utf-8")
            print(page)


if __name__ == "__main__":
    main()
