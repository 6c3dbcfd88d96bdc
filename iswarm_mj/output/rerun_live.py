"""A swarm's recording that a viewer on this machine shows while it is made."""

import sys
from collections.abc import Mapping
from typing import Any

import rerun as rr

from iswarm_mj.output.rerun_format import leave_alone
from iswarm_mj.output.rerun_swarm import Recording
from iswarm_mj.output.rerun_swarm_layout import layout
from iswarm_mj.output.schema import Frames
from iswarm_mj.output.trajectory import Scene
from iswarm_mj.utils.deadline import ends_within

SECONDS = 5.0
"""How long a viewer may take to be reached, and to receive a block [s]."""


class LiveRecording(Recording):
    """A recording that goes to a viewer instead of a file.

    If the viewer is closed, this says so once on the standard error, and further blocks are dropped.
    """

    def __init__(
        self,
        url: str,
        scene: Scene,
        config: Mapping[str, Any],
        properties: Mapping[str, Any],
        lanes: tuple[int, ...] = (),
    ):
        """Connect to the viewer and send everything static; see `Recording`.

        Args:
            url: of the viewer, see `viewer.open_viewer`.
            scene: constants of the run.
            config: shown as a table.
            properties: what identifies the run.
            lanes: robots whose states are shown as lanes; a few by default.

        Raises:
            UserError: the environment disables recordings.
        """
        self._is_lost = False
        super().__init__(url, scene, config, properties, lanes=lanes)

    def append(self, frames: Frames) -> None:
        """Send a block of frames; see `Recording.append`."""
        if not self._is_lost:
            super().append(frames)

    def _open(self) -> None:
        blueprint = layout(self._scene, follows=True)
        # It never ends if the viewer is gone.
        if not ends_within(SECONDS, lambda: self._stream.connect_grpc(self._path, default_blueprint=blueprint)):
            leave_alone(self._stream)
            self._stream = rr.RecordingStream("iswarm_mj")  # whose entities go nowhere
            self._lose()
        self._stream.set_log_time_enabled(False)
        self._stream.set_log_tick_enabled(False)

    def _flush(self) -> None:
        try:
            self._stream.flush(timeout_sec=SECONDS)
        except RuntimeError:
            self._lose()

    def _lose(self) -> None:
        """Send no more blocks."""
        if not self._is_lost:
            print("iswarm: the viewer was closed; the run goes on without it.", file=sys.stderr)
        self._is_lost = True
