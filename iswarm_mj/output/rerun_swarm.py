"""Trajectory -> Rerun recording (.rrd), a block of frames at a time.

What moves is in `rerun_shapes`, the look in `rerun_swarm_view`, the layout of the viewer in `rerun_swarm_layout`.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr

from iswarm_mj.output import rerun_states
from iswarm_mj.output import rerun_swarm_view as look
from iswarm_mj.output.rerun_format import RrdFile, columns_of, index, send_properties, settings_document
from iswarm_mj.output.rerun_shapes import shapes
from iswarm_mj.output.rerun_swarm_layout import layout
from iswarm_mj.output.schema import Frames
from iswarm_mj.output.shapes import TRAIL_FRAMES
from iswarm_mj.output.trajectory import METRIC, Scene


class Recording:
    """A Rerun file of one world, written block by block, which `close` completes.

    Blocks appended before a kill are readable.

    Attributes:
        stream: where further entities go.
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
            scene: constants of the run.
            config: shown as a table beside the arena, and stored as property `settings`; may be nested.
            properties: everything else that identifies the run (seed, version, ...), stored as property `run` with the
                number of the world.

        Raises:
            UserError: the file cannot be written, or the environment disables recordings.
        """
        self._scene = scene
        self._before = np.zeros((0, len(scene.is_scout), 3), np.float32)
        self._last_states = np.full(len(scene.is_scout), len(rerun_states.STATES), np.uint8)
        self._result: dict[str, Any] = {}
        self._file = RrdFile("iswarm_mj", Path(path), layout(scene))
        self.stream = self._file.stream
        self.stream.send_recording_name(f"{Path(path).stem}, world {scene.world}")
        send_properties(self.stream, "settings", config)
        send_properties(self.stream, "run", {**properties, "world": scene.world})
        self._lanes = rerun_states.shown_lanes(scene)
        for entity, archetype in [*look.static_entities(scene), *rerun_states.static_lanes(scene, self._lanes)]:
            self.stream.log(entity, archetype, static=True, strict=True)
        document = settings_document(look.legend(scene), "Parameter", config)
        self.stream.log(look.CONFIG, document, static=True, strict=True)
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
        for entity, shown, lengths, values in shapes(self._scene, frames, self._before):
            self.stream.send_columns(entity, times, columns_of(shown, values, len(frames), lengths), strict=True)
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
        found, names = rerun_states.states_of(self._scene, frames), rerun_states.states(self._scene)
        is_new = np.diff(found, axis=0, prepend=self._last_states[None]) != 0
        for robot in self._lanes:
            when = np.flatnonzero(is_new[:, robot])
            if len(when):
                columns = rr.StateChange.columns(state=[names[place].name for place in found[when, robot]])
                times = index(frames.step[when], self._scene.control_period)
                self.stream.send_columns(rerun_states.lane(robot), times, columns, strict=True)
        self._last_states = found[-1]
