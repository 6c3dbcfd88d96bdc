"""Rerun recording (.rrd) of a trajectory, written block by block, and the layout of the viewer."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from rerun.blueprint.encodings import ComponentSourceKind, VisualizerComponentMapping

from iswarm_mj.output import legend
from iswarm_mj.output import rerun_entities as swarm
from iswarm_mj.output import rerun_format as views
from iswarm_mj.output.memory_vectors import names_without_vectors, recorded_vectors
from iswarm_mj.output.rerun_entities import Block, entities
from iswarm_mj.output.rerun_format import RrdFile, columns_of, index, send_properties
from iswarm_mj.output.schema import LINKS, ROBOTS, Frames
from iswarm_mj.output.shapes import MILLIMETRES, TRAIL_FRAMES, centres
from iswarm_mj.output.swarm_classes import (
    STATES,
    may_send_priority,
    possible_states,
    robot_groups,
    states_of,
)
from iswarm_mj.output.trajectory import METRIC, Scene

LEGEND_ENTITY = "legend"
MAX_LANES = 8
"""Maximum number of robots whose states have a lane each."""
RESULT_COUNTS = ("delivered", "picked", "collisions")
"""Quantities whose last values are part of the property `result`."""
_LINES = "grey from a robot to the one it hears, pink if the message arrived damaged"
_TRAILS = "; blue the trail of a loaded robot"
_HOPS = "**Hop counts**: purple 0, blue 4, teal 8, green 11, yellow 15; grey without a vector."
_SELECTED = """**Selected**: a robot shows its number, its message of 32 bits and the fields of that, its hop
counts (-1: no vector), its turn and its walk; a line the numbers of receiver and sender, side,
LED, and whether the message was heard; a ball its number and its holder; an arrow or a trail the
number of its robot."""
_COLOUR_NAMES = {
    "dump": "yellow the dump",
    "dust area": "sand the dust",
    "obstacle": "dark grey obstacles",
    "box that robots push": "brown boxes",
}
"""What lies on the floor in words, by its entry in `output.legend`."""


class Recording:
    """A Rerun file of one world, written block by block, which `close` completes.

    Blocks that were appended before the process was killed are readable.

    Attributes:
        stream: stream of the recording, to which further entities can be sent.
    """

    def __init__(
        self,
        path: str | Path,
        scene: Scene,
        config: Mapping[str, Any],
        properties: Mapping[str, Any],
    ):
        """Open the file and write everything static.

        Args:
            path: the file to write, by custom `*.rrd`; an existing one is replaced.
            scene: constants of the world.
            config: values of the property `settings`; may be nested.
            properties: everything else that identifies the run (seed, version, ...): values of the
                property `run`, to which the number of the world is added.

        Raises:
            UserError: the file cannot be written, or the environment disables recordings.
        """
        n_robots = len(scene.is_scout)
        self._scene = scene
        self._poses_before = np.zeros((0, n_robots, 3), np.float32)
        no_state = len(STATES)  # so that all states of the first frame count as changes
        self._last_states = np.full(n_robots, no_state, np.uint8)
        self._entities = entities(scene)
        self._lanes = shown_lanes(scene)
        self._result: dict[str, Any] = {}

        self._file = RrdFile("iswarm_mj", Path(path), layout(scene))
        self.stream = self._file.stream
        self.stream.send_recording_name(f"{Path(path).stem}, world {scene.world}")
        send_properties(self.stream, "settings", config)
        send_properties(self.stream, "run", {**properties, "world": scene.world})
        self._log_static()
        self._file.flush()

    def _log_static(self) -> None:
        """Write looks of entities and lanes, and the legend."""
        for entity, look, _ in self._entities:
            if look is not None:
                self.stream.log(entity, look, static=True, strict=True)

        states = possible_states(self._scene)
        names = [state.name for state in states]
        colours = [state.colour for state in states]
        for robot in self._lanes:
            prefix = "scout, " if self._scene.is_scout[robot] else ""
            labels = [prefix + name for name in names]
            look = rr.StateConfiguration(values=names, labels=labels, colors=colours)
            self.stream.log(lane(robot), look, static=True, strict=True)

        text = rr.TextDocument(legend_text(self._scene), media_type=rr.MediaType.MARKDOWN)
        self.stream.log(LEGEND_ENTITY, text, static=True, strict=True)

    def close(self) -> None:
        """Complete the file, with the outcome of the world as property `result`.

        Raises:
            UserError: the disk is full.
        """
        try:
            send_properties(self.stream, "result", self._result)
            self._file.flush()
        finally:
            self._file.close()

    def append(self, frames: Frames) -> None:
        """Write a block of frames, which follow on those appended so far.

        About 64 frames at a time make seeking quick.

        Raises:
            UserError: the disk is full.
        """
        if len(frames) == 0:
            return
        poses = np.concatenate([self._poses_before, frames.pose])
        block = Block(frames, centres(self._scene, poses))
        times = index(frames.step, self._scene.control_period)
        for entity, _, moving in self._entities:
            if moving is not None:
                instances, lengths, values = moving(block)
                columns = columns_of(instances, values, len(frames), lengths)
                self.stream.send_columns(entity, times, columns, strict=True)
        self._write_state_changes(frames)
        self._update_result(frames)
        self._file.flush()
        self._poses_before = poses[-TRAIL_FRAMES:]

    def _update_result(self, frames: Frames) -> None:
        """Keep the counts and metrics of the last frame."""
        arrays = frames.arrays()
        for name in self._scene.metric_names:
            self._result[name] = arrays[METRIC + name][-1]
        for name in RESULT_COUNTS:
            self._result[name] = arrays[name][-1]
        steps_before = self._result.get("steps", 0)
        self._result["steps"] = int(frames.step[frames.is_running].max(initial=steps_before))

    def _write_state_changes(self, frames: Frames) -> None:
        """Write changes of states of the robots that have a lane; in the first frame all change."""
        names = np.array([state.name for state in possible_states(self._scene)])
        states = states_of(self._scene, frames)
        is_change = np.diff(states, axis=0, prepend=self._last_states[None]) != 0
        for robot in self._lanes:
            rows = np.flatnonzero(is_change[:, robot])
            if len(rows):
                columns = rr.StateChange.columns(state=names[states[rows, robot]].tolist())
                times = index(frames.step[rows], self._scene.control_period)
                self.stream.send_columns(lane(robot), times, columns, strict=True)
        self._last_states = states[-1]


def legend_text(scene: Scene) -> str:
    """Return the legend of a recording, without what its swarm does not have."""
    groups = dict(legend.groups(scene, (legend.LINKS, legend.TRAILS)))
    has_balls = len(scene.ball_radius) > 0
    paragraphs = [f"**Robots**{_robots_in_words(scene)}. A dot marks the front."]
    if has_balls:
        paragraphs.append(
            "**Balls**: black on the floor, yellow held, purple delivered; drawn enlarged, above "
            "the robots."
        )
    paragraphs.append(f"**Lines**: {_LINES}{_TRAILS if has_balls else ''}.")
    if any(vector.hop in scene.memory_names for vector in recorded_vectors(scene.memory)):
        paragraphs.append(_HOPS)
    paragraphs.append(_states_in_words(scene))
    paragraphs.append(_SELECTED)

    on_floor = [_COLOUR_NAMES.get(label, label) for label, _ in groups.get("Floor", [])]
    floor = f"**Floor**: {', '.join(on_floor)}. " if on_floor else ""
    paragraphs.append(f"{floor}All lengths are in millimetres.")
    return "\n\n".join(paragraphs)


def _robots_in_words(scene: Scene) -> str:
    """Return what the colours of the robots mean, after the word "Robots"."""
    _, groups = robot_groups(scene)
    has_balls = len(scene.ball_radius) > 0
    if groups:
        return f" by group: {', '.join(groups)}" + ("; darker: loaded" if has_balls else "")
    colours = ["orange empty"]
    if np.any(scene.is_scout):
        colours.append("green scout")
    if has_balls:
        colours.append("blue loaded")
    priority = "; darker: sends priority" if may_send_priority(scene) else ""
    return f": {', '.join(colours)}{priority}"


def _states_in_words(scene: Scene) -> str:
    """Return what the colours of the robots' states mean."""
    names = [state.name for state in possible_states(scene)]
    lighter = "lighter if an empty one knows dust" if "empty, knows dust" in names else ""
    if "loaded, knows dump" in names:
        lighter += (" or " if lighter else "lighter if ") + "a loaded one the dump"
    parts = ["colours as robots", lighter, "greyer if it stands"]
    return f"**States**: {', '.join(part for part in parts if part)}."


def lane(robot: int) -> str:
    """Return the entity of a robot's states."""
    return f"states/robot_{robot}"


def shown_lanes(scene: Scene) -> tuple[int, ...]:
    """Return the robots that get a lane: some that are alive, from the first to the last."""
    alive = np.flatnonzero(scene.is_alive)
    n_lanes = min(MAX_LANES, len(alive))
    places = np.linspace(0, len(alive) - 1, n_lanes, dtype=int)
    return tuple(alive[places].tolist())


def layout(scene: Scene) -> rrb.Blueprint:
    """Return the layout of the viewer."""
    return views.blueprint(swarm_views(scene))


def swarm_views(scene: Scene) -> rrb.Horizontal:
    """Return the arena on the left; time series and states above the legend on the right."""
    tabs = [_plots(scene), _states()]
    memory = [
        views.time_series(f"{swarm.MEMORY}/{name}", name, corner=None)
        for name in names_without_vectors(scene)
    ]
    if memory:
        tabs.append(rrb.Vertical(*memory, name="Memory of each robot"))
    explained = rrb.TextDocumentView(origin=LEGEND_ENTITY, name="Legend")
    right = rrb.Vertical(rrb.Tabs(*tabs, active_tab=0), explained, row_shares=[2, 1])
    return rrb.Horizontal(_arena(scene), right, column_shares=[2, 1])


def _plots(scene: Scene) -> rrb.Vertical:
    """Return the plots of time series: groups with a legend, then single quantities."""
    groups = []
    if scene.metric_names:
        groups.append(views.time_series(swarm.METRICS, "Task"))
    if len(scene.ball_radius):
        groups.append(views.time_series("series/balls", "Balls"))
    if recorded_vectors(scene.memory):
        name = "Share of robots that know it"
        groups.append(views.time_series(swarm.SHARES, name, corner="RightBottom"))

    single_plots = []
    for entity, column in swarm.SERIES.items():
        if entity.count("/") == 1:
            # Titles have units in round brackets, legends in square ones.
            title = swarm.label(column).replace("[", "(").replace("]", ")").capitalize()
            single_plots.append(views.time_series(entity, title, corner=None))
    return rrb.Vertical(*groups, rrb.Horizontal(*single_plots), name="Time series")


def _states() -> rrb.Vertical:
    """Return the lanes of states above the number of robots in each."""
    return rrb.Vertical(
        rrb.StateTimelineView(origin="states", name="States of some robots"),
        views.time_series(swarm.COUNTS, "Robots in each state", corner=None),
        row_shares=[3, 2],
        name="States",
    )


def _coloured_by(component: str) -> Any:
    """Return a look of boxes whose colours are those of a component."""
    source = ComponentSourceKind.SourceComponent
    colours = VisualizerComponentMapping("Boxes3D:colors", source, source_component=component)
    return rr.Boxes3D.from_fields().visualizer(mappings=[colours])


def _with_labels() -> Any:
    """Return a look of boxes with labels, in white, since boxes and labels have one colour."""
    return rr.Boxes3D.from_fields(show_labels=True, colors=(255, 255, 255)).visualizer()


def _arena(scene: Scene) -> rrb.Tabs:
    """Return views of the arena: all of it, each vector, its hop counts, links with numbers."""
    vectors = recorded_vectors(scene.memory)
    arrows = {vector: f"{swarm.ARROWS}/{vector.stem}" for vector in vectors}

    tabs = [_view_from_above(scene, "Arena (mm)", hidden=arrows.values())]
    for vector, entity in arrows.items():
        other_arrows = [name for name in arrows.values() if name != entity]
        hidden = [*other_arrows, LINKS, swarm.TRAILS]
        tabs.append(_view_from_above(scene, f"Vectors: {vector.stem} (mm)", hidden))
    for vector in vectors:
        if vector.hop in scene.memory_names:
            name = f"Hop counts: {vector.stem}"
            hidden = [*arrows.values(), LINKS, swarm.TRAILS, swarm.BALL_MARKERS]
            robots = _coloured_by(f"{vector.hop}_colour")
            tabs.append(_view_from_above(scene, name, hidden, robots))
    hidden = [*arrows.values(), swarm.TRAILS]
    tabs.append(_view_from_above(scene, "Links and ids", hidden, _with_labels()))
    return rrb.Tabs(*tabs, active_tab=0)


def _view_from_above(
    scene: Scene, name: str, hidden: Iterable[str], robots: Any = None
) -> rrb.Spatial3DView:
    """Return a view of the arena from above, slightly from the south.

    Args:
        scene: constants of the world.
        name: title of the view.
        hidden: entities that it does not show.
        robots: look of the robots; by default that of their entity.
    """
    size = scene.arena_size * MILLIMETRES
    overrides: dict[Any, Any] = {entity: rrb.EntityBehavior(visible=False) for entity in hidden}
    if robots is not None:
        overrides[ROBOTS] = robots
    return views.space(
        "world",
        name,
        eye=(0, -0.1 * size, 1.03 * size),
        target=(0, -0.01 * size, 0),
        overrides=overrides,
    )
