"""The layout of the viewer for a swarm's recording."""

from typing import Any

import rerun as rr
import rerun.blueprint as rrb
from rerun.blueprint.encodings import ComponentSourceKind, VisualizerComponentMapping

from iswarm_mj.output import rerun_swarm_view as look
from iswarm_mj.output.memory_vectors import vectors
from iswarm_mj.output.rerun_format import blueprint, space, time_series
from iswarm_mj.output.rerun_names import LINKS, ROBOTS
from iswarm_mj.output.rerun_states import COUNTS
from iswarm_mj.output.trajectory import Scene


def _arena_view(scene: Scene, name: str, *hidden: str, robots: Any = None) -> rrb.Spatial3DView:
    """Return a view from above, slightly from the south, on the whole arena; robots may look otherwise in it."""
    overrides: dict[Any, Any] = {entity: rrb.EntityBehavior(visible=False) for entity in hidden}
    overrides |= {} if robots is None else {ROBOTS: robots}
    size = scene.arena_size * look.MILLIMETRES
    return space("world", name, (0, -0.1 * size, 1.03 * size), (0, -0.01 * size, 0), overrides=overrides)


def _coloured(component: str) -> Any:
    """Boxes in other colours than their own, which a component has."""
    colours = VisualizerComponentMapping(
        "Boxes3D:colors", ComponentSourceKind.SourceComponent, source_component=component
    )
    return rr.Boxes3D.from_fields().visualizer(mappings=[colours])


def arena(scene: Scene) -> rrb.Tabs:
    """Return the views of the arena: of everything, of each remembered vector, of its hop counts, of links with ids."""
    each = vectors(scene)
    arrows = [vector.arrows for vector in each]
    views = [_arena_view(scene, "Arena (mm)", *arrows)]
    for vector in each:
        others = (entity for entity in arrows if entity != vector.arrows)
        name = f"{vector.title.replace('vector', 'Vectors', 1)} (mm)"
        views.append(_arena_view(scene, name, *others, LINKS, look.TRAILS))
    for vector in each:
        if vector.hop in scene.memory_names:
            name, hidden = vector.title.replace("vector", "Hop counts", 1), (LINKS, look.TRAILS, look.BALL_MARKERS)
            views.append(_arena_view(scene, name, *arrows, *hidden, robots=_coloured(vector.hop_colour)))
    numbered = rr.Boxes3D.from_fields(show_labels=True, colors=(255, 255, 255)).visualizer()  # as are the labels then
    views.append(_arena_view(scene, "Links and ids", *arrows, look.TRAILS, robots=numbered))
    return rrb.Tabs(*views, active_tab=0)


def content(scene: Scene) -> rrb.Horizontal:
    """Return the arena on the left; time series, states and configuration above the legend on the right."""
    plots = rrb.Vertical(
        *([time_series(look.METRICS, "Task", "LeftTop")] if scene.metric_names else []),
        *([time_series("series/balls", "Balls", "LeftTop")] if len(scene.ball_radius) else []),
        *([time_series("series/known", "Share of robots", "RightBottom")] if scene.arrows else []),
        rrb.Horizontal(*(time_series(entity, name[0].upper() + name[1:], None) for entity, name in _single(scene))),
        name="Time series",
    )
    states = rrb.Vertical(
        rrb.StateTimelineView(origin="states", name="States of some robots"),
        time_series(COUNTS, "Robots in each state", None),
        row_shares=[3, 2],
        name="States",
    )
    memory = [time_series(f"{look.MEMORY}/{name}", name, None) for name in look.numbers(scene)]
    tabs = rrb.Tabs(
        plots,
        states,
        *([rrb.Vertical(*memory, name="Memory of each robot")] if memory else []),
        rrb.TextDocumentView(origin=look.CONFIG, name="Configuration"),
        active_tab=0,
    )
    key = rrb.TextDocumentView(origin=look.KEY, name="Legend")
    return rrb.Horizontal(arena(scene), rrb.Vertical(tabs, key, row_shares=[2, 1]), column_shares=[2, 1])


def _single(scene: Scene) -> list[tuple[str, str]]:
    """Time series with a plot of their own: their entities, and their names with units in round brackets."""
    words = {entity: name.replace("[", "(").replace("]", ")") for entity, (name, _) in look.series(scene).items()}
    return [(entity, name) for entity, name in words.items() if entity.count("/") == 1]


def layout(scene: Scene, follows: bool = False) -> rrb.Blueprint:
    """Return the layout.

    Args:
        scene: what does not change.
        follows: show the newest step, whenever one comes.
    """
    return blueprint(content(scene), play_state="following" if follows else None)
