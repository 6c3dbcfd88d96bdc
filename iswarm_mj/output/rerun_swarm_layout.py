"""The layout of the viewer for a swarm's recording."""

from typing import Any

import rerun as rr
import rerun.blueprint as rrb
from rerun.blueprint.encodings import ComponentSourceKind, VisualizerComponentMapping

from iswarm_mj.output import rerun_swarm_view as look
from iswarm_mj.output.memory import numbers, vectors
from iswarm_mj.output.rerun_format import blueprint, space, time_series
from iswarm_mj.output.rerun_names import ARROWS, BALL_MARKERS, COUNTS, MEMORY, METRICS, SHARES, TRAILS
from iswarm_mj.output.schema import LINKS, ROBOTS
from iswarm_mj.output.trajectory import Scene


def _coloured(component: str) -> Any:
    """Boxes in other colours than their own, which a component has."""
    source = ComponentSourceKind.SourceComponent
    colours = VisualizerComponentMapping("Boxes3D:colors", source, source_component=component)
    return rr.Boxes3D.from_fields().visualizer(mappings=[colours])


def _arena(scene: Scene) -> rrb.Tabs:
    """Views of the arena: of everything, of each remembered vector, of its hop counts, of links with ids."""
    each, size = vectors(scene.memory), scene.arena_size * look.MILLIMETRES
    arrows = {vector: f"{ARROWS}/{vector.stem}" for vector in each}

    def view(name: str, *hidden: str, robots: Any = None) -> rrb.Spatial3DView:
        """From above, slightly from the south; robots may look otherwise in it."""
        overrides: dict[Any, Any] = {entity: rrb.EntityBehavior(visible=False) for entity in hidden}
        overrides |= {} if robots is None else {ROBOTS: robots}
        return space("world", name, (0, -0.1 * size, 1.03 * size), (0, -0.01 * size, 0), overrides=overrides)

    views = [view("Arena (mm)", *arrows.values())]
    for vector, own in arrows.items():
        others = (entity for entity in arrows.values() if entity != own)
        views.append(view(f"Vectors: {vector.stem} (mm)", *others, LINKS, TRAILS))
    for vector in each:
        if vector.hop in scene.memory_names:
            hidden, robots = (*arrows.values(), LINKS, TRAILS, BALL_MARKERS), _coloured(f"{vector.hop}_colour")
            views.append(view(f"Hop counts: {vector.stem}", *hidden, robots=robots))
    numbered = rr.Boxes3D.from_fields(show_labels=True, colors=(255, 255, 255)).visualizer()  # as are the labels then
    return rrb.Tabs(*views, view("Links and ids", *arrows.values(), TRAILS, robots=numbered), active_tab=0)


def content(scene: Scene) -> rrb.Horizontal:
    """Return the arena on the left; time series, states and configuration above the legend on the right."""
    own = {  # time series with a plot of their own, whose names have units in round brackets
        entity: name.replace("[", "(").replace("]", ")").capitalize()
        for entity, (name, _) in look.series(scene).items()
        if entity.count("/") == 1
    }
    plots = rrb.Vertical(
        *([time_series(METRICS, "Task", "LeftTop")] if scene.metric_names else []),
        *([time_series("series/balls", "Balls", "LeftTop")] if len(scene.ball_radius) else []),
        *([time_series(SHARES, "Share of robots that know it", "RightBottom")] if vectors(scene.memory) else []),
        rrb.Horizontal(*(time_series(entity, name, None) for entity, name in own.items())),
        name="Time series",
    )
    states = rrb.Vertical(
        rrb.StateTimelineView(origin="states", name="States of some robots"),
        time_series(COUNTS, "Robots in each state", None),
        row_shares=[3, 2],
        name="States",
    )
    memory = [time_series(f"{MEMORY}/{name}", name, None) for name in numbers(scene)]
    tabs = rrb.Tabs(
        plots,
        states,
        *([rrb.Vertical(*memory, name="Memory of each robot")] if memory else []),
        rrb.TextDocumentView(origin=look.CONFIG, name="Configuration"),
        active_tab=0,
    )
    key = rrb.TextDocumentView(origin=look.KEY, name="Legend")
    return rrb.Horizontal(_arena(scene), rrb.Vertical(tabs, key, row_shares=[2, 1]), column_shares=[2, 1])


def layout(scene: Scene) -> rrb.Blueprint:
    """Return the layout."""
    return blueprint(content(scene))
