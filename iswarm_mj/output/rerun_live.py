"""A swarm's recording that a viewer on this machine shows while it is made."""

import sys

import rerun as rr

from iswarm_mj.output.rerun_format import bounded, leave_alone
from iswarm_mj.output.rerun_swarm import Recording
from iswarm_mj.output.rerun_swarm_layout import layout
from iswarm_mj.output.schema import Frames

SECONDS = 5.0
"""How long a viewer may take to be reached, and to receive a block [s]."""


class LiveRecording(Recording):
    """A recording that goes to a viewer, whose address (`viewer.open_viewer`) is its path, instead of a file.

    If the viewer is closed, this says so once on the standard error, and further blocks are dropped.
    """

    _is_lost = False

    def append(self, frames: Frames) -> None:
        """Send a block of frames; see `Recording.append`."""
        if not self._is_lost:
            super().append(frames)

    def _open(self) -> None:
        blueprint = layout(self._scene, follows=True)
        try:  # it never ends if the viewer is gone
            bounded(lambda: self.stream.connect_grpc(self._path, default_blueprint=blueprint), SECONDS)
        except TimeoutError:
            leave_alone(self.stream)
            self.stream = rr.RecordingStream("iswarm_mj")  # whose entities go nowhere
            self._lose()
        self.stream.set_log_time_enabled(False)
        self.stream.set_log_tick_enabled(False)

    def _flush(self) -> None:
        try:
            self.stream.flush(timeout_sec=SECONDS)
        except RuntimeError:
            self._lose()

    def _lose(self) -> None:
        if not self._is_lost:
            print("iswarm: the viewer was closed; the run goes on without it.", file=sys.stderr)
        self._is_lost = True
