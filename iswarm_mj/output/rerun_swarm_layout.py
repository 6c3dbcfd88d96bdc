"""The layout of the viewer for a swarm's recording."""

from collections.abc import Mapping
from typing import Any

import rerun as rr
import rerun.blueprint as rrb
from rerun.blueprint.encodings import ComponentSourceKind, VisualizerComponentMapping

from iswarm_mj.output import rerun_swarm_view as look
from iswarm_mj.output.rerun_format import time_series
from iswarm_mj.output.rerun_states import COUNTS
from iswarm_mj.output.rerun_swarm_view import MILLIMETRES
from iswarm_mj.output.trajectory import Scene


def _arena_view(
    scene: Scene, name: str, hidden: tuple[str, ...], others: Mapping[str, Any] | None = None
) -> rrb.Spatial3DView:
    """Return a view from above, slightly from the south, on the whole arena."""
    overrides: dict[Any, Any] = {entity: rrb.EntityBehavior(visible=False) for entity in hidden}
    size = scene.arena_size * MILLIMETRES
    eye = rrb.EyeControls3D(position=(0, -0.1 * size, 1.03 * size), look_target=(0, -0.01 * size, 0), eye_up=(0, 0, 1))
    return rrb.Spatial3DView(
        origin="world",
        name=name,
        eye_controls=eye,
        line_grid=False,
        background=(24, 26, 30),
        overrides=overrides | dict(others or {}),
    )


def _hops(hop: str) -> Any:
    """Boxes in the colours of a hop count, which the recording has beside the boxes' own."""
    colours = VisualizerComponentMapping(
        "Boxes3D:colors", ComponentSourceKind.SourceComponent, source_component=look.hop_colour(hop)
    )
    return rr.Boxes3D.from_fields().visualizer(mappings=[colours])


def _views(scene: Scene) -> rrb.Tabs:
    """Return the views of the arena: of everything, of each remembered vector, of its hop counts, of links with ids."""
    arrows = [look.arrows(name) for name in scene.arrows]
    lines = (look.LINKS, look.TRAILS)
    numbered = rr.Boxes3D.from_fields(show_labels=True, colors=(255, 255, 255)).visualizer()  # as are the labels then
    vectors = [
        _arena_view(
            scene,
            f"{look.title(name).replace('vector', 'Vectors', 1)} (mm)",
            (*(entity for entity in arrows if entity != look.arrows(name)), *lines),
        )
        for name in scene.arrows
    ]
    hops = [
        _arena_view(
            scene,
            look.title(name).replace("vector", "Hop counts", 1),
            (*arrows, *lines, look.BALL_MARKERS),
            {look.ROBOTS: _hops(look.hop(name))},
        )
        for name in scene.arrows
        if look.hop(name) in scene.memory_names
    ]
    ids = _arena_view(scene, "Links and ids", (*arrows, look.TRAILS), {look.ROBOTS: numbered})
    return rrb.Tabs(_arena_view(scene, "Arena (mm)", tuple(arrows)), *vectors, *hops, ids, active_tab=0)


def layout(scene: Scene, follows: bool = False) -> rrb.Blueprint:
    """Return the layout: the arena on the left; time series, states and configuration above the legend on the right.

    Args:
        scene: what does not change.
        follows: show the newest step, whenever one comes.
    """
    shares = time_series("series/known", "Share of robots", "RightBottom")
    memory = [time_series(f"{look.MEMORY}/{name}", name, None) for name in look.numbers(scene)]
    plots = rrb.Vertical(
        *([time_series("series/task", "Task", "LeftTop")] if scene.metric_names else []),
        *([time_series("series/balls", "Balls", "LeftTop")] if len(scene.ball_radius) else []),
        *([shares] if scene.arrows else []),
        rrb.Horizontal(
            time_series("series/collisions", "Collisions", None),
            time_series("series/mean_speed", "Mean speed (mm/s)", None),
        ),
        name="Time series",
    )
    states = rrb.Vertical(
        rrb.StateTimelineView(origin="states", name="States of some robots"),
        time_series(COUNTS, "Robots in each state", None),
        row_shares=[3, 2],
        name="States",
    )
    return rrb.Blueprint(
        rrb.Horizontal(
            _views(scene),
            rrb.Vertical(
                rrb.Tabs(
                    plots,
                    states,
                    *([rrb.Vertical(*memory, name="Memory of each robot")] if memory else []),
                    rrb.TextDocumentView(origin=look.CONFIG, name="Configuration"),
                    active_tab=0,
                ),
                rrb.TextDocumentView(origin=look.KEY, name="Legend"),
                row_shares=[2, 1],
            ),
            column_shares=[2, 1],
        ),
        rrb.TimePanel(timeline="sim_time", state="collapsed", play_state="following" if follows else None),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        auto_layout=False,
        auto_views=False,
    )
