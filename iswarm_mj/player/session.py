"""A run that can be played with: a plain object that one thread works on, and that others post to."""

import copy
import math
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from queue import Empty, SimpleQueue
from statistics import median
from threading import Lock
from typing import Any, NamedTuple

import numpy as np

from iswarm_mj.output.frames import RecordedWorld
from iswarm_mj.output.schema import ARRAYS, Frames
from iswarm_mj.output.shapes import TRAIL_FRAMES
from iswarm_mj.output.trajectory import METRIC
from iswarm_mj.player.changes import EDITS, Change, edit
from iswarm_mj.player.controls import is_live, parsed
from iswarm_mj.player.scenario import Scenario, command_line, toml
from iswarm_mj.simulation.state import StepRecord
from iswarm_mj.utils.errors import UserError
from iswarm_mj.workflows.recorder import Recorder

AHEAD = 2
"""Control steps that are computed ahead of what is shown, so that motion stays smooth."""
LONGEST = 4000
"""Control steps that are plotted, the latest ones."""


class Snapshot(NamedTuple):
    """A world after a control step."""

    frames: Frames
    """One frame."""
    record: StepRecord
    """(1, 1, ...)."""

    @property
    def step(self) -> int:
        """Control steps taken."""
        return int(self.frames.step[0])

    @property
    def energy(self) -> np.ndarray | None:
        """In the robots' capacitors (N,) [J]; None where they have none."""
        energy = self.record.swarm.energy
        return None if energy is None else np.asarray(energy)[0, 0]


class Session:
    """A run, what was changed in it, and what its latest control steps looked like.

    Attributes:
        start: scenario with which the run began.
        now: with the settings that were changed since.
        wanted: also with those that wait for a reset.
        made: changes of this run, in their order.
        waiting: changes that are still to be made.
        is_playing: control steps are taken one after the other.
        is_busy: something is computed at present.
        shown: control step that is shown at present; infinite where nobody watches.
        snapshots: the latest ones.
        lines: numbers after each step by the names of metrics, and `step`.
        version: counts resets.
        messages: one-line errors for whoever plays.
        rate: control steps a second that could be computed.
        lock: held while another run takes the place of the present one, and by whoever draws.
    """

    def __init__(self, scenario: Scenario, changes: Sequence[Change] = (), out: Path = Path("runs/play")):
        """Begin a run.

        Args:
            scenario: of the run.
            changes: to be made in it.
            out: directory for recordings.

        Raises:
            UserError: settings or changes that do not fit each other.
        """
        changed = scenario
        for change in changes:
            if change.what not in EDITS:
                changed = changed.set(change.what, parsed(changed, change.what, change.value))
        self.wanted, self.waiting, self._out = scenario, sorted(changes, key=lambda change: change.step), out
        self.version, self.is_playing, self.is_busy, self.shown, self.rate = 0, False, False, math.inf, math.inf
        self.messages: SimpleQueue[str] = SimpleQueue()
        self.lock = Lock()
        self._posted: SimpleQueue[Callable[[], None]] = SimpleQueue()
        self._recorder: Recorder | None = None
        self._begin(scenario)
        for change in self.waiting:
            if change.what in EDITS:
                edit(self.run, change)  # which refuses what cannot be

    def _begin(self, scenario: Scenario) -> None:
        run = scenario.run()
        world = RecordedWorld.of(run, 0)
        with self.lock:
            self.start = self.now = self.wanted = scenario
            self.made: list[Change] = []
            self.run, self.world = run, world
            self.snapshots: deque[Snapshot] = deque(maxlen=TRAIL_FRAMES + AHEAD + 2)
            self.lines: dict[str, deque[float]] = {}
            self.version += 1
            self._laps: deque[float] = deque(maxlen=9)
            self._seen(run.start)

    @property
    def scene(self) -> Any:
        """Constants of the world, see `Scene`."""
        return self.world.scene

    @property
    def step(self) -> int:
        """Control steps taken."""
        return self.snapshots[-1].step

    @property
    def is_alive(self) -> np.ndarray:
        """Which robots are (N,), those just killed left out."""
        return self.snapshots[-1].frames.is_alive[0]

    def post(self, call: Callable[[], None]) -> None:
        """Have something done between two control steps, by the thread that works on this session."""
        self._posted.put(call)

    def work(self) -> bool:
        """Do what was posted, then take a control step if one is due; return whether there was anything to do."""
        worked = False
        while True:
            try:
                call = self._posted.get_nowait()
            except Empty:
                break
            self._guarded(call)
            worked = True
        if not self.step and self.wanted != self.start:  # nothing has happened yet
            self._guarded(self.reset)
        self.is_playing &= not self.run.is_over
        if self.is_playing and self.step - self.shown < AHEAD:
            self._guarded(self.advance)
            worked = True
        return worked

    def _guarded(self, call: Callable[[], None]) -> None:
        self.is_busy = True
        try:
            call()
        except UserError as error:
            self.messages.put(str(error))
        finally:
            self.is_busy = False

    def advance(self) -> None:
        """Take a control step, unless nothing is left to do."""
        if self.run.is_over:
            return
        while self.waiting and self.waiting[0].step <= self.step:
            self.change(*self.waiting.pop(0)[1:])
        began = time.perf_counter()
        record = self.run.advance()
        took = time.perf_counter() - began
        if self.step:  # the first step compiles
            self._laps.append(took)
            self.rate = 1 / median(self._laps)
        assert record is not None  # world 0 is recorded
        self._seen(record)
        if self._recorder is not None:
            self._recorder.add(record)
        for fault in self.run.faults:
            self.messages.put(str(fault))

    def reset(self) -> None:
        """Begin again with the wanted settings.

        Raises:
            UserError: they do not fit each other; the present run goes on, with its settings.
        """
        self.stop_recording()
        wanted, self.wanted = self.wanted, self.now
        self._begin(wanted)
        self.waiting = []

    def set(self, name: str, value: Any) -> None:
        """Change a setting, at once where that is possible, else from the next reset on.

        Raises:
            UserError: it is out of range, or contradicts another one.
        """
        self.wanted = self.wanted.set(name, value)
        if self.step and is_live(self.now, name):
            self.change(name, str(value).lower() if isinstance(value, bool) else str(value))

    def change(self, what: str, value: str) -> None:
        """Change a setting that may change while the run goes on, a robot or a ball; see `Change`."""
        change = Change(self.step, what, value)
        if what in EDITS:
            self.run.edit(edit(self.run, change))
            last, alive = self.snapshots[-1], np.asarray(self.run.arrays()[1].swarm.is_alive)
            self.snapshots[-1] = last._replace(frames=replace(last.frames, is_alive=alive[:1]))
        else:
            now = self.now.set(what, parsed(self.now, what, value))
            task = now.task if now.task != self.now.task else None
            self.run.change(now.config, now.strategy, task)
            if task is not None:
                self.world = RecordedWorld.of(self.run, 0)
            self.now, self.wanted = now, self.wanted.set(what, now.get(what))
            self.made = [one for one in self.made if one[:2] != change[:2]]
        self.made.append(change)

    def _seen(self, record: StepRecord) -> None:
        """Take in what a control step looks like."""
        frames = self.world.frames([record])
        self.snapshots.append(Snapshot(frames, record))
        arrays = frames.arrays()
        for name in ("step", *self.run.task.measured, "collisions", "mean_speed"):
            line = self.lines.setdefault(name, deque(maxlen=LONGEST))
            line.append(float(arrays[name if name in ARRAYS else METRIC + name][0]))

    def values(self) -> dict[str, Any]:
        """Return the settings and changes that reproduce the run so far, by the names of flags."""
        own = self.start.values()
        return own | ({"changes": tuple(map(str, self.made))} if self.made else {"steps": max(1, self.step)})

    def command(self) -> str:
        """Return a command that reproduces the run so far: `iswarm run`, or `iswarm play` where something changed."""
        return command_line("play" if self.made else "run", self.values())

    def toml(self) -> str:
        """Return a file for --config of that command."""
        return f"# iswarm {'play' if self.made else 'run'} --config FILE\n{toml(self.values())}"

    def start_recording(self) -> Path:
        """Record to a new file for Rerun, from the present state on; return its name."""
        self._out.mkdir(parents=True, exist_ok=True)
        number = next(k for k in range(1, 10**6) if not (self._out / f"play-{k}.rrd").exists())
        run = copy.copy(self.run)
        run.start = self.snapshots[-1].record
        path = self._out / f"play-{number}.rrd"
        self._recorder = Recorder(run, path)
        return path

    def stop_recording(self) -> None:
        """Complete the file."""
        if self._recorder is not None:
            self._recorder.save()
        self._recorder = None
