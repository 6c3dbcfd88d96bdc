"""The legend of a picture of a swarm: what its colours mean, as far as the swarm has them."""

from collections.abc import Collection
from typing import NamedTuple

from iswarm_mj.output import palette
from iswarm_mj.output.memory_vectors import recorded_vectors
from iswarm_mj.output.palette import Rgb, rgb
from iswarm_mj.output.swarm_classes import BALL_CLASSES, DEAD, LINK_CLASSES, shown_classes
from iswarm_mj.output.trajectory import Scene

LINKS = "links"
TRAILS = "trails"
BALLS = "Balls, drawn enlarged"
"""Heading of the colours of balls."""
ARROW_COLOURS = tuple(map(rgb, (palette.SKY, palette.YELLOW, palette.GREEN, palette.PINK)))
"""Colours of the arrows, one for each remembered vector in turn."""


class Entry(NamedTuple):
    """A colour and what it means."""

    label: str
    colour: Rgb


class Group(NamedTuple):
    """Entries of one kind under a heading."""

    heading: str
    entries: list[Entry]


def groups(
    scene: Scene,
    drawn: Collection[str],
    robots: list[Entry] | None = None,
    *,
    has_dead: bool = False,
) -> list[Group]:
    """Return the legend of a picture, without what the swarm does not have.

    Args:
        scene: constants of the world.
        drawn: which of `LINKS`, `TRAILS` and the names of remembered vectors the picture has.
        robots: colours of the robots; None for those of their states.
        has_dead: the picture shows dead robots.
    """
    if robots is None:
        robots = [Entry(label, colour) for _, label, colour in shown_classes(scene)]
    if has_dead:
        robots = [*robots, Entry("dead", DEAD.colour)]

    balls = []
    if len(scene.ball_radius):
        balls = [Entry(label, colour) for _, label, colour in BALL_CLASSES]
    every_group = [
        Group("Robots", robots),
        Group(BALLS, balls),
        Group("Lines", _lines(scene, drawn)),
        Group("Floor", _floor(scene)),
    ]
    return [group for group in every_group if group.entries]


def _lines(scene: Scene, drawn: Collection[str]) -> list[Entry]:
    """Return what lines and arrows mean."""
    entries = []
    if LINKS in drawn:
        (_, _, damaged), (_, _, heard) = LINK_CLASSES
        entries.append(Entry("link, heard", heard))
        entries.append(Entry("link, damaged message", damaged))
    if TRAILS in drawn and len(scene.ball_radius):
        entries.append(Entry("trail", rgb(palette.SKY)))
    for k, vector in enumerate(recorded_vectors(scene.memory)):
        if vector.stem in drawn:
            colour = ARROW_COLOURS[k % len(ARROW_COLOURS)]
            entries.append(Entry(f"remembers {vector.stem}", colour))
    return entries


def _floor(scene: Scene) -> list[Entry]:
    """Return what lies and stands on the floor."""
    entries = []
    if scene.dump[2] > scene.dump[0]:
        entries.append(Entry("dump", rgb(palette.DUMP)))
    if len(scene.dust_areas):
        entries.append(Entry("dust area", rgb(palette.DUST)))
    for name, colour in zip(scene.area_names, scene.area_colours, strict=True):
        red, green, blue = colour
        entries.append(Entry(name.replace("_", " "), (red, green, blue)))
    if len(scene.obstacles):
        entries.append(Entry("obstacle", rgb(palette.WALL)))
    if len(scene.boxes):
        entries.append(Entry("box that robots push", rgb(palette.BOX)))
    return entries
