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

from iswarm_mj.output import rerun_states
from iswarm_mj.output import rerun_swarm_view as look
from iswarm_mj.output.frame_checks import check_frames
from iswarm_mj.output.frames import HELD
from iswarm_mj.output.remembered import hop_colours, hop_counts, is_known
from iswarm_mj.output.rerun_format import (
    FLUSH_SECONDS,
    bounded,
    close,
    columns_of,
    index,
    leave_alone,
    require_recordings,
    send_properties,
    settings_document,
    written,
)
from iswarm_mj.output.rerun_lines import TRAIL_FRAMES, links_of, robot_classes, robots_of, strips, trails
from iswarm_mj.output.rerun_swarm_layout import layout
from iswarm_mj.output.rerun_swarm_view import MILLIMETRES
from iswarm_mj.output.said import payload_of, readable
from iswarm_mj.output.trajectory import AREA, METRIC, Frames, Scene
from iswarm_mj.utils.errors import UserError
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
        self._path, self._scene, self._payload = str(path), scene, payload_of({"scene_payload": scene.payload})
        self._before = np.zeros((0, len(scene.is_scout), 3), np.float32)
        self._last_step = -1
        self._result: dict[str, Any] = {}
        self._stream = rr.RecordingStream(application)
        require_recordings(self._stream)
        self._open()
        self._stream.set_log_time_enabled(False)
        self._stream.set_log_tick_enabled(False)
        self._stream.send_recording_name(f"{Path(self._path).stem}, world {scene.world}")
        send_properties(self._stream, "settings", config)
        send_properties(self._stream, "run", {**properties, "world": scene.world})
        robots = rerun_states.shown_lanes(scene, lanes)
        self._lanes = rerun_states.Lanes(robots)
        for entity, archetype in [*look.static_entities(scene), *rerun_states.static_lanes(scene, robots)]:
            self._stream.log(entity, archetype, static=True, strict=True)
        document = settings_document(look.legend(scene), "Parameter", config)
        self._stream.log(look.CONFIG, document, static=True, strict=True)
        self._flush()

    def _open(self) -> None:
        """Open the file, with the layout."""
        try:
            Path(self._path).open("wb").close()
            bounded(lambda: self._stream.save(self._path, default_blueprint=layout(self._scene)))
        except (OSError, RuntimeError, ValueError) as error:  # a name with a null byte is the last
            leave_alone(self._stream)
            raise UserError(
                f"The recording {self._path!r} cannot be written ({error}): "
                "give a file name in an existing folder that you may write to."
            ) from error

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
            self._stream.flush(timeout_sec=FLUSH_SECONDS)

    def append(self, frames: Frames) -> None:
        """Write a block of frames, about 64 of them for quick seeking, which follow on those appended so far.

        Raises:
            SimulationFault: a pose, a ball or a known vector is not finite.
            UserError: the disk is full.
            ValueError: steps do not increase.
        """
        if len(frames) == 0:
            return
        check_frames(self._scene, frames, self._last_step)
        self._index, self._n_frames = index(frames.step, self._scene.control_period), len(frames)
        size = np.asarray(self._scene.robot_size, np.float32) * np.float32(MILLIMETRES)
        yaw = frames.pose[..., 2]
        centres = np.empty_like(frames.pose, dtype=np.float32)
        centres[..., :2] = frames.pose[..., :2] * np.float32(MILLIMETRES)
        centres[..., 2] = size[2] / 2
        self._robots(frames, centres, yaw, size)
        self._balls(frames)
        self._lines(frames, centres)
        top = centres.copy()
        top[..., 2] = 1.1 * size[2]
        for name in self._scene.arrows:
            self._arrows(look.arrows(name), top, yaw, frames.memory[name], is_known(frames, name))
        self._memory(frames)
        self._areas(frames)
        self._states(frames)
        self._series(frames)
        self._flush()
        self._last_step = int(frames.step[-1])
        self._note(frames)

    def _note(self, frames: Frames) -> None:
        """Keep what the world has come to."""
        values = {name: frames.task[METRIC + name] for name in self._scene.metric_names}
        values |= {"delivered": frames.delivered, "picked": frames.picked, "collisions": frames.collisions}
        taken = np.asarray(frames.step)[np.asarray(frames.is_running)]
        self._result |= {name: value[-1] for name, value in values.items()}
        self._result["steps"] = int(taken[-1]) if len(taken) else self._result.get("steps", 0)

    def _send(self, entity: str, shown: Any, lengths: np.ndarray | int = 1, **values: np.ndarray) -> None:
        """Send columns of one entity; row t gets the next `lengths[t]` instances, or each the same number.

        `values` are shown by the viewer where an instance is selected.
        """
        columns = columns_of(shown, values, self._n_frames, lengths)
        self._stream.send_columns(entity, self._index, columns, strict=True)

    def _robots(self, frames: Frames, centres: np.ndarray, yaw: np.ndarray, size: np.ndarray) -> None:
        """Boxes coloured by state, and a dot at each front."""
        n_robots = yaw.shape[1]
        quaternions = np.zeros((*yaw.shape, 4), np.float32)
        quaternions[..., 2], quaternions[..., 3] = np.sin(yaw / 2), np.cos(yaw / 2)
        boxes = rr.Boxes3D.from_fields(
            centers=centres.reshape(-1, 3),
            quaternions=quaternions.reshape(-1, 4),
            class_ids=robot_classes(frames.is_loaded, self._scene.is_scout, frames.has_priority).reshape(-1),
        )
        hops = hop_counts(self._scene, frames)
        self._send(
            look.ROBOTS,
            boxes,
            n_robots,
            message=frames.message,
            **readable(self._payload, self._scene.n_leds, frames.message),
            **hops,
            **{look.hop_colour(name): hop_colours(values) for name, values in hops.items()},
            turn_deg=np.rad2deg(frames.command[..., 0]),
            forward_mm=frames.command[..., 1] * np.float32(MILLIMETRES),
        )
        fronts = centres + 0.34 * size[0] * np.stack([np.cos(yaw), np.sin(yaw), np.zeros_like(yaw)], axis=-1)
        fronts[..., 2] = size[2] + look.FRONT_RADIUS * size[0]
        self._send(look.FRONTS, rr.Points3D.from_fields(positions=fronts.reshape(-1, 3)), n_robots)

    def _balls(self, frames: Frames) -> None:
        """Points of true size; above the robots, markers that stay visible with the whole arena in view."""
        n_balls = frames.ball_position.shape[1]
        positions = (frames.ball_position * np.float32(MILLIMETRES)).reshape(-1, 3)
        classes = (frames.ball_state.reshape(-1) + look.BALL_CLASS_OFFSET).astype(np.uint16)
        above = positions + np.array([0, 0, 1.5 * self._scene.robot_size[2] * MILLIMETRES])
        holder = {"holder": np.where(frames.ball_state == HELD, frames.ball_holder, -1).astype(np.int16)}
        for entity, shown in ((look.BALLS, positions), (look.BALL_MARKERS, above)):
            points = rr.Points3D.from_fields(positions=shown, class_ids=classes)
            self._send(entity, points, n_balls, **(holder if entity == look.BALLS else {}))

    def _lines(self, frames: Frames, centres: np.ndarray) -> None:
        """Links of each step, and the trails of robots now loaded."""
        links = links_of(centres, frames)
        self._send(
            look.LINKS,
            rr.LineStrips3D.from_fields(
                strips=links.strips, class_ids=links.is_heard + np.uint16(look.LINK_CLASS_OFFSET)
            ),
            links.counts,
            receiver=links.receiver,
            side=links.side,
            sender=links.sender,
            led=links.led,
            is_heard=links.is_heard,
        )
        history = np.concatenate([self._before, centres])
        points, lengths = trails(history, len(self._before), frames.is_loaded)
        trail = rr.LineStrips3D.from_fields(strips=strips(points, lengths))
        loaded = frames.is_loaded
        self._send(look.TRAILS, trail, np.count_nonzero(loaded, axis=1), robot=robots_of(loaded))
        self._before = history[-TRAIL_FRAMES:]

    def _arrows(self, entity: str, origins: np.ndarray, yaw: np.ndarray, vector: np.ndarray, known: np.ndarray) -> None:
        """Arrows from the robots that know a vector, turned to the world."""
        place = np.flatnonzero(known)
        vectors = np.zeros((len(place), 3), np.float32)
        vectors[:, :2] = rotate(vector.reshape(-1, 2)[place], yaw.ravel()[place]) * np.float32(MILLIMETRES)
        shown = rr.Arrows3D.from_fields(origins=origins.reshape(-1, 3)[place], vectors=vectors)
        self._send(entity, shown, np.count_nonzero(known, axis=1), robot=robots_of(known))

    def _memory(self, frames: Frames) -> None:
        """Numbers and flags that the robots remember, a series for each number of each robot."""
        for name in look.numbers(self._scene):
            values = frames.memory[name].reshape(len(frames), -1).astype(np.float64)
            self._send(f"{look.MEMORY}/{name}", rr.Scalars(values.reshape(-1)), values.shape[1])

    def _areas(self, frames: Frames) -> None:
        """Areas of the task on the floor, which may move."""
        for name, shape in zip(self._scene.area_names, self._scene.area_shapes, strict=True):
            areas = frames.task[AREA + name].astype(np.float64) * MILLIMETRES
            self._send(look.area(name), look.areas(areas.reshape(-1, 3), shape), areas.shape[1])

    def _states(self, frames: Frames) -> None:
        """How many robots are in each state, and the changes of some robots' states."""
        names, found = rerun_states.names(self._scene), rerun_states.states_of(self._scene, frames)
        counts = rerun_states.counts(found, len(names)).astype(np.float64)
        self._send(rerun_states.COUNTS, rr.Scalars(counts.reshape(-1)), len(names))
        for robot, when in self._lanes.changes(found).items():
            columns = rr.StateChange.columns(state=[names[place] for place in found[when, robot]])
            when_columns = index(frames.step[when], self._scene.control_period)
            self._stream.send_columns(rerun_states.lane(robot), when_columns, columns, strict=True)

    def _series(self, frames: Frames) -> None:
        """Time series; counts are cumulative, shares are of all robots, the speed is in mm/s."""
        values = {
            "series/balls/picked": frames.picked,
            "series/balls/delivered": frames.delivered,
            "series/collisions": frames.collisions,
            "series/mean_speed": frames.mean_speed * MILLIMETRES,
        }
        for name in self._scene.arrows:
            values[look.known(name)] = is_known(frames, name).mean(axis=1)
        for name in self._scene.metric_names:
            values[look.metric(name)] = frames.task[METRIC + name]
        for entity in look.series(self._scene):
            self._send(entity, rr.Scalars(np.asarray(values[entity], np.float64)))
