"""Trajectory -> Rerun recording (.rrd): SI in, millimetres out.

The look is defined in `rerun_swarm_view`, the layout of the viewer in `rerun_swarm_layout`. Written column by column, a
block of frames at a time, never with a call per robot or per frame.
"""

from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
import rerun as rr
from jaxtyping import Float, Shaped

from iswarm_mj.output import rerun_states
from iswarm_mj.output import rerun_swarm_view as look
from iswarm_mj.output.memory_colors import hop_colours, hop_counts
from iswarm_mj.output.memory_vectors import is_known, vectors
from iswarm_mj.output.message_columns import payload_of, shown_fields
from iswarm_mj.output.rerun_format import (
    check_recordings,
    close,
    columns_of,
    flush,
    index,
    save,
    send_properties,
    settings_document,
    written,
)
from iswarm_mj.output.rerun_lines import TRAIL_FRAMES, links_of, robots_of, strips, trails
from iswarm_mj.output.rerun_names import BALLS, LINKS, ROBOTS, series_values, shown_values
from iswarm_mj.output.rerun_swarm_layout import layout
from iswarm_mj.output.rerun_swarm_view import MILLIMETRES
from iswarm_mj.output.schema import Frames
from iswarm_mj.output.trajectory import AREA, METRIC, Scene
from iswarm_mj.utils.errors import SimulationFault, UserError
from iswarm_mj.utils.geometry import rotate


class Recording:
    """A Rerun file of one world, written block by block.

    Leaving the `with` block, also by an exception, completes the file.
    Blocks appended before a kill are readable.
    """

    def __init__(
        self,
        path: str | Path,
        scene: Scene,
        config: Mapping[str, Any],
        properties: Mapping[str, Any],
        application: str = "iswarm_mj",
        lanes: tuple[int, ...] = (),
    ):
        """Open the file and write everything static.

        Args:
            path: the file to write, by custom `*.rrd`; an existing one is replaced.
            scene: constants of the run.
            config: shown as a table beside the arena, and stored as property `settings`; may be nested.
            properties: everything else that identifies the run (seed, version, ...), stored as property `run` with the
                number of the world.
            application: recordings of one application share the viewer's layout, and are one dataset of it.
            lanes: robots whose states are shown as lanes; a few by default.

        Raises:
            UserError: the file cannot be written, or the environment disables recordings.
        """
        self._path, self._scene, self._payload = str(path), scene, payload_of(scene.payload)
        self._before = np.zeros((0, len(scene.is_scout), 3), np.float32)
        self._vectors, self._last_step = vectors(scene), -1
        self._last_states: np.ndarray | None = None
        self._result: dict[str, Any] = {}
        self._stream = rr.RecordingStream(application)
        check_recordings(self._stream)
        self._open()
        self._stream.send_recording_name(f"{Path(self._path).stem}, world {scene.world}")
        send_properties(self._stream, "settings", config)
        send_properties(self._stream, "run", {**properties, "world": scene.world})
        self._lanes = rerun_states.shown_lanes(scene, lanes)
        for entity, archetype in [*look.static_entities(scene), *rerun_states.static_lanes(scene, self._lanes)]:
            self._stream.log(entity, archetype, static=True, strict=True)
        document = settings_document(look.legend(scene), "Parameter", config)
        self._stream.log(look.CONFIG, document, static=True, strict=True)
        self._flush()

    def _open(self) -> None:
        """Open the file, with the layout."""
        with written(self._path, self._stream):
            save(self._stream, Path(self._path), layout(self._scene))

    @property
    def stream(self) -> rr.RecordingStream:
        """Where further entities go."""
        return self._stream

    def __enter__(self) -> "Recording":
        """Return the open recording."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        """Complete and close the file, with what the world came to as property `result`; exceptions pass."""
        try:
            try:
                send_properties(self._stream, "result", self._result)
                self._flush()
            finally:
                with written(self._path, self._stream):
                    close(self._stream, self._path)
        except UserError:
            if error is None:
                raise

    def _flush(self) -> None:
        """Write everything to the file, which fails if the disk is full."""
        with written(self._path, self._stream):
            flush(self._stream, self._path)

    def append(self, frames: Frames) -> None:
        """Write a block of frames, about 64 of them for quick seeking, which follow on those appended so far.

        Raises:
            SimulationFault: a pose, a ball or a known vector is not finite.
            UserError: the disk is full.
            ValueError: steps do not increase.
        """
        if len(frames) == 0:
            return
        self._check(frames)
        self._index, self._n_frames = index(frames.step, self._scene.control_period), len(frames)
        height = self._scene.robot_size[2] * MILLIMETRES
        centres = np.full(frames.pose.shape, height / 2, np.float32)
        centres[..., :2] = frames.pose[..., :2] * np.float32(MILLIMETRES)
        self._robots(frames, centres)
        self._balls(frames)
        self._lines(frames, centres)
        self._memory(frames, centres + np.array([0, 0, 0.6 * height], np.float32))
        self._areas(frames)
        self._states(frames)
        self._series(frames)
        self._flush()
        self._last_step = int(frames.step[-1])

    def _check(self, frames: Frames) -> None:
        """Refuse values that the viewer would silently draw wrong."""
        if np.any(np.diff(frames.step, prepend=self._last_step) <= 0):
            raise ValueError(f"Steps must increase: {frames.step[0]}..{frames.step[-1]} after {self._last_step}.")
        drawn = {"pose of robots": frames.pose, "position of balls": frames.ball_position}
        for vector in self._vectors:
            known = is_known(frames, vector)[..., None]
            drawn[f"{vector.title} of robots"] = np.where(known, frames.memory[vector.name], 0)
        for name, values in drawn.items():
            is_bad = np.any(~np.isfinite(values), axis=-1)
            if is_bad.any():
                t = int(np.argmax(is_bad.any(axis=1)))
                which = ", ".join(map(str, np.flatnonzero(is_bad[t])[:10]))
                raise SimulationFault(f"Step {frames.step[t]}: the {name} {which} is not finite.")

    def _send(
        self, entity: str, shown: rr.AsComponents, lengths: np.ndarray | int = 1, **values: Shaped[np.ndarray, "..."]
    ) -> None:
        """Send columns of one entity; row t gets the next `lengths[t]` instances, or each the same number.

        `values` are shown by the viewer where an instance is selected.
        """
        columns = columns_of(shown, values, self._n_frames, lengths)
        self._stream.send_columns(entity, self._index, columns, strict=True)

    def _robots(self, frames: Frames, centres: Float[np.ndarray, "T N 3"]) -> None:
        """Boxes coloured by state, and a dot at each front."""
        yaw, (length, _, height) = (
            frames.pose[..., 2],
            np.asarray(self._scene.robot_size, np.float32) * np.float32(MILLIMETRES),
        )
        zero, cos, sin = np.zeros_like(yaw), np.cos(yaw), np.sin(yaw)
        boxes = rr.Boxes3D.from_fields(
            centers=centres.reshape(-1, 3),
            quaternions=np.stack([zero, zero, np.sin(yaw / 2), np.cos(yaw / 2)], axis=-1).reshape(-1, 4),
            class_ids=look.robot_classes(frames.is_loaded, self._scene.is_scout, frames.has_priority).reshape(-1),
        )
        hops = hop_counts(self._scene, frames)
        values = shown_values(ROBOTS, frames) | shown_fields(self._payload, self._scene.n_leds, frames.message)
        values |= hops | {v.hop_colour: hop_colours(hops[v.hop]) for v in self._vectors if v.hop in hops}
        self._send(ROBOTS, boxes, yaw.shape[1], **values)
        fronts = centres + 0.34 * length * np.stack([cos, sin, zero], axis=-1)
        fronts[..., 2] = height + look.FRONT_RADIUS * length
        self._send(look.FRONTS, rr.Points3D.from_fields(positions=fronts.reshape(-1, 3)), yaw.shape[1])

    def _balls(self, frames: Frames) -> None:
        """Points of true size; above the robots, markers that stay visible with the whole arena in view."""
        n_balls = frames.ball_position.shape[1]
        positions = (frames.ball_position * np.float32(MILLIMETRES)).reshape(-1, 3)
        classes = (frames.ball_state.reshape(-1) + look.BALL_CLASS_OFFSET).astype(np.uint16)
        above = positions + np.array([0, 0, 1.5 * self._scene.robot_size[2] * MILLIMETRES])
        points = rr.Points3D.from_fields(positions=positions, class_ids=classes)
        self._send(BALLS, points, n_balls, **shown_values(BALLS, frames))
        self._send(look.BALL_MARKERS, rr.Points3D.from_fields(positions=above, class_ids=classes), n_balls)

    def _lines(self, frames: Frames, centres: Float[np.ndarray, "T N 3"]) -> None:
        """Links of each step, and the trails of robots now loaded."""
        lines, counts, numbers = links_of(centres, frames)
        classes = numbers["is_heard"] + np.uint16(look.LINK_CLASS_OFFSET)
        self._send(LINKS, rr.LineStrips3D.from_fields(strips=lines, class_ids=classes), counts, **numbers)
        history, loaded = np.concatenate([self._before, centres]), frames.is_loaded
        trail = rr.LineStrips3D.from_fields(strips=strips(*trails(history, len(self._before), loaded)))
        self._send(look.TRAILS, trail, np.count_nonzero(loaded, axis=1), robot=robots_of(loaded))
        self._before = history[-TRAIL_FRAMES:]

    def _memory(self, frames: Frames, origins: Float[np.ndarray, "T N 3"]) -> None:
        """Arrows from the robots that know a vector, turned to the world; a series for other numbers of each robot."""
        for vector in self._vectors:
            known = is_known(frames, vector)
            ends = np.zeros((np.count_nonzero(known), 3), np.float32)
            turned = rotate(frames.memory[vector.name][known], frames.pose[..., 2][known])
            ends[:, :2] = turned * np.float32(MILLIMETRES)
            shown = rr.Arrows3D.from_fields(origins=origins[known], vectors=ends)
            self._send(vector.arrows, shown, np.count_nonzero(known, axis=1), robot=robots_of(known))
        for name in look.numbers(self._scene):
            values = frames.memory[name].reshape(len(frames), -1).astype(np.float64)
            self._send(f"{look.MEMORY}/{name}", rr.Scalars(values.reshape(-1)), values.shape[1])

    def _areas(self, frames: Frames) -> None:
        """Areas of the task on the floor, which may move."""
        for name, shape in zip(self._scene.area_names, self._scene.area_shapes, strict=True):
            areas = frames.task[AREA + name].astype(np.float64) * MILLIMETRES
            self._send(f"{look.AREAS}/{name}", look.areas(areas.reshape(-1, 3), shape), areas.shape[1])

    def _states(self, frames: Frames) -> None:
        """How many robots are in each state, and the changes of some robots' states."""
        names = [state.name for state in rerun_states.states(self._scene)]
        found = rerun_states.states_of(self._scene, frames)
        counts = np.stack([np.count_nonzero(found == place, axis=1) for place in range(len(names))], axis=1)
        self._send(rerun_states.COUNTS, rr.Scalars(counts.reshape(-1).astype(np.float64)), len(names))
        for robot, when in rerun_states.changes(found, self._last_states, self._lanes).items():
            columns = rr.StateChange.columns(state=[names[place] for place in found[when, robot]])
            times = index(frames.step[when], self._scene.control_period)
            self._stream.send_columns(rerun_states.lane(robot), times, columns, strict=True)
        self._last_states = found[-1]

    def _series(self, frames: Frames) -> None:
        """Time series; shares are of all robots. Keeps what the world has come to."""
        values = series_values(frames)
        values |= {vector.share: is_known(frames, vector).mean(axis=1) for vector in self._vectors}
        counts = {name: frames.task[METRIC + name] for name in self._scene.metric_names}
        values |= {f"{look.METRICS}/{name}": each for name, each in counts.items()}
        for entity in look.series(self._scene):
            self._send(entity, rr.Scalars(np.asarray(values[entity], np.float64)))
        counts |= {"delivered": frames.delivered, "picked": frames.picked, "collisions": frames.collisions}
        self._result |= {name: each[-1] for name, each in counts.items()}
        self._result["steps"] = int(frames.step[frames.is_running].max(initial=self._result.get("steps", 0)))
