"""Trajectory -> Rerun recording (.rrd), a block of frames at a time; and the layout of the viewer."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from rerun.blueprint.encodings import ComponentSourceKind, VisualizerComponentMapping

from iswarm_mj.output import rerun_entities as shown
from iswarm_mj.output import rerun_format as views
from iswarm_mj.output.memory import numbers, vectors
from iswarm_mj.output.rerun_entities import Block, entities
from iswarm_mj.output.rerun_format import RrdFile, columns_of, index, send_properties
from iswarm_mj.output.schema import LINKS, ROBOTS, Frames
from iswarm_mj.output.shapes import MILLIMETRES, TRAIL_FRAMES, centres
from iswarm_mj.output.swarm_classes import STATES, groups, states, states_of
from iswarm_mj.output.trajectory import METRIC, Scene

KEY = "legend"
MOST_LANES = 8
"""Robots whose states have a lane each, at most."""
LEGEND = """**Robots**{robots}. A dot marks the front.

**Balls**: black on the floor, yellow held, purple delivered; drawn enlarged, above the robots.

**Lines**: grey from a robot to the one it hears, pink if the message arrived damaged; blue the trail of a loaded robot.

**Hop counts**: purple 0, blue 4, teal 8, green 11, yellow 15; grey without a vector.

**States**: colours as robots, lighter if an empty one knows dust or a loaded one the dump, greyer if it stands.

**Selected**: a robot shows its number, its message of 32 bits and what that says, its hop counts (-1: no vector), its
turn and its way; a line the numbers of receiver and sender, side, LED, and whether the message was heard; a ball its
number and its holder; an arrow or a trail the number of its robot.

**Floor**: yellow the dump, sand the dust. All lengths are in millimetres."""


class Recording:
    """A Rerun file of one world, written block by block, which `close` completes.

    Blocks appended before a kill are readable.

    Attributes:
        stream: where further entities go.
    """

    def __init__(self, path: str | Path, scene: Scene, config: Mapping[str, Any], properties: Mapping[str, Any]):
        """Open the file and write everything static.

        Args:
            path: the file to write, by custom `*.rrd`; an existing one is replaced.
            scene: constants of the run.
            config: stored as property `settings`; may be nested.
            properties: everything else that identifies the run (seed, version, ...), stored as property `run` with the
                number of the world.

        Raises:
            UserError: the file cannot be written, or the environment disables recordings.
        """
        self._scene = scene
        self._before = np.zeros((0, len(scene.is_scout), 3), np.float32)
        self._last_states = np.full(len(scene.is_scout), len(STATES), np.uint8)
        self._entities, self._lanes = entities(scene), shown_lanes(scene)
        self._result: dict[str, Any] = {}
        self._file = RrdFile("iswarm_mj", Path(path), layout(scene))
        self.stream = self._file.stream
        self.stream.send_recording_name(f"{Path(path).stem}, world {scene.world}")
        send_properties(self.stream, "settings", config)
        send_properties(self.stream, "run", {**properties, "world": scene.world})
        for entity, look, _ in self._entities:
            if look is not None:
                self.stream.log(entity, look, static=True, strict=True)
        names, colours = zip(*((state.name, state.colour) for state in states(scene)), strict=True)
        for robot in self._lanes:
            labels = [f"scout, {name}" if scene.is_scout[robot] else name for name in names]
            look = rr.StateConfiguration(values=names, labels=labels, colors=colours)
            self.stream.log(lane(robot), look, static=True, strict=True)
        own = groups(scene)[1]
        usual = ": orange empty, green scout, blue loaded; darker: sends priority"
        robots = f" by group: {', '.join(own)}; darker: loaded" if own else usual
        key = rr.TextDocument(LEGEND.format(robots=robots), media_type=rr.MediaType.MARKDOWN)
        self.stream.log(KEY, key, static=True, strict=True)
        self._file.flush()

    def close(self) -> None:
        """Complete the file, with what the world came to as property `result`.

        Raises:
            UserError: the disk is full.
        """
        try:
            send_properties(self.stream, "result", self._result)
            self._file.flush()
        finally:
            self._file.close()

    def append(self, frames: Frames) -> None:
        """Write a block of frames, about 64 of them for quick seeking, which follow on those appended so far.

        Raises:
            UserError: the disk is full.
        """
        if len(frames) == 0:
            return
        times = index(frames.step, self._scene.control_period)
        block = Block(frames, centres(self._scene, np.concatenate([self._before, frames.pose])))
        for entity, _, moving in self._entities:
            if moving is not None:
                instances, lengths, values = moving(block)
                columns = columns_of(instances, values, len(frames), lengths)
                self.stream.send_columns(entity, times, columns, strict=True)
        self._change_lanes(frames)
        names = {METRIC + name: name for name in self._scene.metric_names}
        names |= {name: name for name in ("delivered", "picked", "collisions")}
        arrays = frames.arrays()
        self._result |= {name: arrays[array][-1] for array, name in names.items()}
        self._result["steps"] = int(frames.step[frames.is_running].max(initial=self._result.get("steps", 0)))
        self._file.flush()
        self._before = np.concatenate([self._before, frames.pose])[-TRAIL_FRAMES:]

    def _change_lanes(self, frames: Frames) -> None:
        """Write where states of the robots that have a lane change; in the first frame all do."""
        found, names = states_of(self._scene, frames), states(self._scene)
        is_new = np.diff(found, axis=0, prepend=self._last_states[None]) != 0
        for robot in self._lanes:
            when = np.flatnonzero(is_new[:, robot])
            if len(when):
                columns = rr.StateChange.columns(state=[names[place].name for place in found[when, robot]])
                times = index(frames.step[when], self._scene.control_period)
                self.stream.send_columns(lane(robot), times, columns, strict=True)
        self._last_states = found[-1]


def lane(robot: int) -> str:
    """Return the entity of a robot's states."""
    return f"states/robot_{robot}"


def shown_lanes(scene: Scene) -> tuple[int, ...]:
    """Return the robots that get a lane: some that are alive, from the first to the last."""
    alive = np.flatnonzero(scene.is_alive)
    places = np.linspace(0, len(alive) - 1, min(MOST_LANES, len(alive)), dtype=int)
    return tuple(alive[places].tolist())


def layout(scene: Scene) -> rrb.Blueprint:
    """Return the layout of the viewer."""
    return views.blueprint(content(scene))


def content(scene: Scene) -> rrb.Horizontal:
    """Return the arena on the left; time series and states above the legend on the right."""
    own = {  # time series with a plot of their own, whose names have units in round brackets
        entity: shown.label(column).replace("[", "(").replace("]", ")").capitalize()
        for entity, column in shown.SERIES.items()
        if entity.count("/") == 1
    }
    series = [
        (scene.metric_names, shown.METRICS, "Task", "LeftTop"),
        (scene.ball_radius, "series/balls", "Balls", "LeftTop"),
        (vectors(scene.memory), shown.SHARES, "Share of robots that know it", "RightBottom"),
    ]
    plots = rrb.Vertical(
        *(views.time_series(*about) for are_there, *about in series if len(are_there)),
        rrb.Horizontal(*(views.time_series(entity, name, None) for entity, name in own.items())),
        name="Time series",
    )
    states = rrb.Vertical(
        rrb.StateTimelineView(origin="states", name="States of some robots"),
        views.time_series(shown.COUNTS, "Robots in each state", None),
        row_shares=[3, 2],
        name="States",
    )
    memory = [views.time_series(f"{shown.MEMORY}/{name}", name, None) for name in numbers(scene)]
    tabs = rrb.Tabs(
        plots,
        states,
        *([rrb.Vertical(*memory, name="Memory of each robot")] if memory else []),
        active_tab=0,
    )
    key = rrb.TextDocumentView(origin=KEY, name="Legend")
    return rrb.Horizontal(_arena(scene), rrb.Vertical(tabs, key, row_shares=[2, 1]), column_shares=[2, 1])


def _coloured(component: str) -> Any:
    """Boxes in other colours than their own, which a component has."""
    source = ComponentSourceKind.SourceComponent
    colours = VisualizerComponentMapping("Boxes3D:colors", source, source_component=component)
    return rr.Boxes3D.from_fields().visualizer(mappings=[colours])


def _arena(scene: Scene) -> rrb.Tabs:
    """Views of the arena: of everything, of each remembered vector, of its hop counts, of links with ids."""
    each, size = vectors(scene.memory), scene.arena_size * MILLIMETRES
    arrows = {vector: f"{shown.ARROWS}/{vector.stem}" for vector in each}

    def view(name: str, *hidden: str, robots: Any = None) -> rrb.Spatial3DView:
        """From above, slightly from the south; robots may look otherwise in it."""
        overrides: dict[Any, Any] = {entity: rrb.EntityBehavior(visible=False) for entity in hidden}
        overrides |= {} if robots is None else {ROBOTS: robots}
        return views.space("world", name, (0, -0.1 * size, 1.03 * size), (0, -0.01 * size, 0), overrides=overrides)

    tabs = [view("Arena (mm)", *arrows.values())]
    for vector, own in arrows.items():
        others = (entity for entity in arrows.values() if entity != own)
        tabs.append(view(f"Vectors: {vector.stem} (mm)", *others, LINKS, shown.TRAILS))
    for vector in each:
        if vector.hop in scene.memory_names:
            hidden, robots = (
                (*arrows.values(), LINKS, shown.TRAILS, shown.BALL_MARKERS),
                _coloured(f"{vector.hop}_colour"),
            )
            tabs.append(view(f"Hop counts: {vector.stem}", *hidden, robots=robots))
    numbered = rr.Boxes3D.from_fields(show_labels=True, colors=(255, 255, 255)).visualizer()  # as are the labels then
    return rrb.Tabs(*tabs, view("Links and ids", *arrows.values(), shown.TRAILS, robots=numbered), active_tab=0)
