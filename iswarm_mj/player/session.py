"""An interactive run: one thread works on it, and others post to it."""

import copy
import itertools
import math
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from queue import SimpleQueue
from statistics import median
from threading import Lock
from typing import Any, NamedTuple

import jax
import numpy as np

from iswarm_mj.config.setting_names import PARTS
from iswarm_mj.output.frames import RecordedWorld
from iswarm_mj.output.schema import ARRAYS, Frames
from iswarm_mj.output.shapes import TRAIL_FRAMES
from iswarm_mj.output.trajectory import METRIC
from iswarm_mj.player.changes import EDITS, Change, edit
from iswarm_mj.player.controls import (
    Control,
    controls,
    in_page_units,
    may_change_at_once,
    parsed,
)
from iswarm_mj.player.faults import Faults
from iswarm_mj.player.inbox import Inbox
from iswarm_mj.player.next_start import Misfit, NextStart
from iswarm_mj.player.scenario import PageScenario
from iswarm_mj.player.scene import areas_differ
from iswarm_mj.player.user_files import Stamps, UserCode, names_of_files
from iswarm_mj.simulation.scenario_flags import command_line, is_same, toml
from iswarm_mj.simulation.state import StepRecord
from iswarm_mj.utils.errors import UserError
from iswarm_mj.workflows.recorder import Recorder

LOOK_S = 0.5
"""Time between two looks at users' files [s]."""
AHEAD = 2
"""Control steps that are computed ahead of what is shown, so that motion stays smooth."""
_COMPILATION = "Usually 10 to 30 s once, longer on a busy machine, and a few seconds later on."
"""How long the first step of a program takes."""
MOST_PLOTTED = 4000
"""Largest number of control steps that are plotted, the latest ones."""
MOST_RECORDINGS = 100
"""Recordings that a session makes at most; each is a file and takes some memory."""


class Snapshot(NamedTuple):
    """A world after a control step."""

    frames: Frames
    """One frame."""
    record: StepRecord
    """Record of the step, arrays (1, 1, ...)."""

    @property
    def step(self) -> int:
        """Control steps taken."""
        return int(self.frames.step[0])

    @property
    def energy(self) -> np.ndarray | None:
        """Energy in the robots' capacitors (N,) [J]; None where they have none."""
        energy = self.record.swarm.energy
        if energy is None:
            return None
        return np.asarray(energy)[0, 0]


class Activity(NamedTuple):
    """What a session does at present."""

    text: str
    """What is done, as an object of "Preparing"."""
    began: float
    """When it began, by the clock `time.monotonic` [s]."""
    duration: str = ""
    """How long it usually takes, as a sentence; empty where nothing can be said."""


class Session:
    """A run, the changes made in it, and a picture of its latest control steps.

    Attributes:
        run: the run, whose first world is played with.
        world: what is recorded and drawn of that world.
        start: scenario with which the run began.
        now: scenario with the settings that were changed since.
        next_start: settings that wait for a reset.
        changes: changes of this run so far, in their order.
        waiting: changes that are still to be made.
        is_playing: control steps are taken one after the other.
        activity: what is computed at present; None where nothing is.
        shown: control step that is shown at present; infinite where nobody watches.
        snapshots: latest control steps.
        version: number of runs so far, one more after each reset.
        messages: one-line errors for whoever plays.
        rate: control steps a second that could be computed; infinite until two were.
        faults: exceptions that were shown.
        inbox: work that browsers asked for.
        out: directory for recordings and sweeps.
        recording: latest file for Rerun; None before the first one.
        changed_files: names of these files that have changed since they were read.
        file_error: why the present content of such a file cannot be used; empty if it can.
        reloads_by_itself: the run begins again whenever such a file changes.
        lock: held while another run takes the place of the present one, and by whoever draws.
    """

    def __init__(
        self,
        scenario: PageScenario,
        changes: Sequence[Change] = (),
        out: Path = Path("runs/play"),
    ):
        """Begin a run.

        Args:
            scenario: scenario of the run.
            changes: changes to be made in it.
            out: directory for recordings.

        Raises:
            UserError: settings or changes that do not fit each other.
        """
        _check_changes(scenario, changes)
        self._initial = scenario
        self.out = out
        self._refused: PageScenario | None = None
        self.waiting = sorted(changes, key=lambda change: change.step)
        self.version = 0
        self.is_playing = False
        self.activity: Activity | None = None
        self.shown = math.inf
        self.rate = math.inf
        self.messages: SimpleQueue[str] = SimpleQueue()
        self.faults = Faults()
        self.inbox = Inbox()
        self.lock = Lock()
        self.recording: Path | None = None
        self._n_recordings = 0
        self._recorder: Recorder | None = None
        self._recording_lock = Lock()
        self.changed_files: list[str] = []
        self.file_error = ""
        self.reloads_by_itself = False
        self._code = UserCode().including(scenario)
        self._tried: Stamps = {}
        self._looked_at = time.monotonic()
        self._begin(NextStart.of(scenario))
        for change in self.waiting:
            if change.name in EDITS:
                edit(self.run, change)  # which refuses what cannot be

    def _begin(self, next_start: NextStart) -> None:
        """Begin another run and complete the recording; where that fails, all stays as it was."""
        scenario = next_start.fitting
        run = scenario.run()
        world = RecordedWorld.of_run(run, 0)
        frames = world.frames([run.start])
        self.stop_recording()
        with self.lock:
            self.start = scenario
            self.now = scenario
            self.next_start = next_start
            self._running_code = self._code
            self.changes: list[Change] = []
            self.run = run
            self.world = world
            self.snapshots: deque[Snapshot] = deque(maxlen=TRAIL_FRAMES + AHEAD + 2)
            self._points: deque[dict[str, float]] = deque(maxlen=MOST_PLOTTED)
            self.version += 1
            self.rate = math.inf
            self._laps: deque[float] = deque(maxlen=9)
            self.faults.forget()
            self._append(frames, run.start)

    @property
    def wanted(self) -> PageScenario:
        """Scenario with the settings, too, that wait for a reset."""
        return self.next_start.wanted

    @property
    def misfit(self) -> Misfit | None:
        """Why a run cannot begin with `wanted` yet; None where it can."""
        return self.next_start.misfit

    @property
    def scene(self) -> Any:
        """Constants of the world, see `Scene`."""
        return self.world.scene

    @property
    def step(self) -> int:
        """Control steps taken."""
        return self.snapshots[-1].step

    @property
    def lines(self) -> dict[str, list[float]]:
        """Numbers after each of the latest control steps by the names of metrics, and `step`."""
        points = list(self._points)  # another thread adds to them
        return {name: [point[name] for point in points] for name in points[0]}

    @property
    def is_alive(self) -> np.ndarray:
        """Robots that are alive (N,), without those just killed."""
        return self.snapshots[-1].frames.is_alive[0]

    def post(self, call: Callable[[], None], control: str | None = None) -> None:
        """Have something done between two control steps, by the thread that works on this session.

        Args:
            call: what is done.
            control: unique name of the control that the call sets; None for a click.

        Raises:
            UserError: too many clicks wait.
        """
        if control is None:
            self.inbox.put_click(call)
        else:
            self.inbox.put_value(control, call)

    def work(self) -> bool:
        """Do what was posted, then take a control step if one is due; return whether anything was.

        What goes wrong is shown to whoever plays, and pauses the run.
        """
        worked = False

        # No more calls than wait now, so that no flood of them stops the run.
        for _ in range(len(self.inbox)):
            call = self.inbox.take()
            if call is not None:
                self._succeeds(call)
                worked = True

        # Nothing has happened yet: settings need not wait for a reset.
        start = self.next_start.fitting
        is_new = not is_same(start, self.start) and start is not self._refused
        if not self.step and is_new:
            self._succeeds(self._restart)

        self._look_at_files()
        self.is_playing &= not self.run.is_over
        if self.is_playing and self.step - self.shown < AHEAD:
            if not self._succeeds(self.advance):
                self.is_playing = False
            worked = True
        return worked

    def _restart(self) -> None:
        """Begin again with other settings before the first step, and keep all changes that fit."""
        made = self.changes
        scheduled = self.waiting
        self.reset()
        for change in made:
            self._is_possible(change, lambda change: self.change(change.name, change.value))
        self.waiting = [each for each in scheduled if self._is_possible(each, self._check_change)]

    def _is_possible(self, change: Change, attempt: Callable[[Change], Any]) -> bool:
        """Return whether an attempt with a change succeeds; whoever plays sees why it does not."""
        try:
            attempt(change)
        except UserError as error:
            self.messages.put(f"the change {change} is left out: {error}")
            return False
        return True

    def _check_change(self, change: Change) -> None:
        """Check that a change is possible in this run.

        Raises:
            UserError: there is no such setting, robot or place, or the value is out of range.
        """
        if change.name in EDITS:
            edit(self.run, change)
        else:
            _check_changes(self.now, [change])

    @property
    def has_files(self) -> bool:
        """The strategy or the task that waits for a reset is of a user's file."""
        return bool(names_of_files(self.wanted))

    def _look_at_files(self) -> None:
        """Notice users' files that have changed, twice a second; read them if this is wished."""
        if time.monotonic() - self._looked_at < LOOK_S:
            return
        self._looked_at = time.monotonic()
        changed = self._changed_files()
        if changed and changed != self._tried and self.reloads_by_itself:
            self._succeeds(self.reload)

    def _changed_files(self) -> Stamps:
        """Return the present stamps of files that have changed since they were read; show them."""
        next_start = self.next_start
        changed = self._code.changed_files(next_start.wanted, next_start.fitting)
        self.changed_files = [path.name for path in changed]
        return changed

    def reload(self) -> None:
        """Read the files of strategy and task again, and begin again with what they have now.

        Raises:
            UserError: no part is of a file, or a file has an error; then the run goes on.
        """
        if not self.has_files:
            raise UserError(
                "strategy and task are of no file; name one, as --strategy walk.py:Walk"
            )
        if self._takes_new_code():
            self.reset()

    def _takes_new_code(self) -> bool:
        """Let what waits have the code that its files have now; return whether it could.

        An error of a file is shown, and the old code goes on.
        """
        next_start = self.next_start
        self._tried = self._changed_files()
        if not self._tried:
            self.file_error = ""
            return True
        try:
            code = self._code.read_again(next_start.wanted, next_start.fitting)
            renew = partial(code.renewed, before=self._code)
            initial = renew(self._initial)
            next_start = next_start.renewed(renew)
        except UserError as error:
            self.file_error = f"{error}; the old code goes on"
            self.messages.put(self.file_error)
            return False
        self.file_error = ""
        self.changed_files = []
        self._code = code
        self._initial = initial
        self.next_start = next_start
        return True

    def _succeeds(self, call: Callable[[], None]) -> bool:
        """Return whether a call raised no exception; whoever plays sees those it raises."""
        try:
            with self._doing("the change"):
                call()
        except UserError as error:
            self.messages.put(str(error))
        except (Exception, SystemExit) as error:
            self.fail(error)
        else:
            return True
        return False

    @contextmanager
    def _doing(self, text: str, duration: str = "") -> Iterator[None]:
        """State what is done within the block, see `Activity`."""
        before = self.activity
        self.activity = Activity(text, time.monotonic(), duration)
        try:
            yield
        finally:
            self.activity = before

    def fail(self, error: BaseException) -> None:
        """Pause, and show an exception to whoever plays; the next reset begins anew."""
        self.is_playing = False
        self.messages.put(self.faults.report(error))

    def advance(self) -> None:
        """Take a control step, unless nothing is left to do."""
        if self.run.is_over:
            return
        while self.waiting and self.waiting[0].step <= self.step:
            due = self.waiting.pop(0)
            self.change(due.name, due.value)

        began = time.perf_counter()
        with self._doing(*self._next_step()):
            record = self.run.advance()
        duration = time.perf_counter() - began
        if self.step:  # the first step compiles
            self._laps.append(duration)
            self.rate = 1 / median(self._laps)

        assert record is not None  # world 0 is recorded
        self._append(self.world.frames([record]), record)
        with self._recording_lock:
            if self._recorder is not None:
                self._recorder.add(record)
        for fault in self.run.faults:
            self.messages.put(str(fault))

    def _next_step(self) -> tuple[str, str]:
        """Return what the next step does, and its usual duration; the first one compiles."""
        if self.step:
            return "the next step", ""
        return f"the next step: compiling {self._program}", _COMPILATION

    @property
    def _program(self) -> str:
        """Name of what is compiled for a run."""
        now = self.now
        engine = now.get("engine")
        parts = f"{now.strategy_label} on {now.task_label}"
        return f"{parts} for {now.n_robots} robots with the engine {engine}"

    def reset(self) -> None:
        """Begin again with the wanted settings, and with users' files as they are now.

        A misfit goes on waiting.

        Raises:
            UserError: no run can begin so; the present one goes on, and all settings go on waiting.
        """
        self._takes_new_code()
        start = self.next_start.fitting
        self._refused = start  # unless the reset succeeds
        start.check()
        is_other_program = not is_same(replace(start, seed=self.now.seed), self.now)
        if self.step and is_other_program:
            # JAX keeps each program for ever, 50 MB for each number of robots; the
            # cache on disk still has those that come back.
            jax.clear_caches()
        with self._doing(f"a run of {start.n_robots} robots"):
            self._begin(self.next_start)
        self._refused = None
        self.waiting = []

    def controls(self) -> list[Control]:
        """Return the controls of the page: rules of what runs, then settings of what waits.

        A rule that both have is one of what runs, and `change` carries it into what waits. Only
        names of controls are unique among the live ones, and among the others.
        """
        now = self.now  # once, as another thread replaces both
        wanted = self.wanted
        rules = [control for control in controls(now, self._initial) if control.is_live]
        carried = {wanted.shared_name(rule.name, now) for rule in rules}
        waiting = [
            control._replace(is_live=False)
            for control in controls(wanted, self._initial)
            if control.name not in carried
        ]
        return rules + waiting

    @property
    def pending(self) -> dict[str, str]:
        """What the next reset changes: old and new value by the label of the setting."""
        now = self.now  # once, as another thread replaces both
        start = self.next_start.fitting
        present = {control.name: control.value for control in controls(now)}
        texts = {}
        for control in map(in_page_units, controls(start)):
            name = now.shared_name(control.name, start)
            if name is None or name not in present:  # of another strategy or task
                continue
            before = control.of_page(present[name])
            if not is_same(control.value, before):
                texts[control.label] = (
                    f"{control.text_of(before)} → {control.text_of(control.value)}"
                )
        if start.n_robots != now.n_robots and start.robots is None:
            texts["robots"] += f", as robots stand on {100 * start.density:.3g} % of the free floor"
        if start.config.arena.obstacles != now.config.arena.obstacles:
            n_before = len(now.config.arena.obstacles)
            texts["obstacles"] = f"{n_before} → {len(start.config.arena.obstacles)}"
        return texts

    def set(self, name: str, value: Any) -> None:
        """Change a setting of what runs at once if possible, else from the next reset on.

        Raises:
            UserError: there is none, it is out of range, or it contradicts another one.
        """
        if not (self.step and may_change_at_once(self.now, name)):
            self.want(name, value)
            return
        text = str(value)
        if isinstance(value, bool):
            text = text.lower()
        self.change(name, text)

    def want(self, name: str, value: Any) -> None:
        """Change a setting of what waits for the next reset.

        The name of the first strategy, task or engine stands for the very object, which may be of a
        file that has changed, or of none.

        Raises:
            UserError: there is none, it is out of range, or it contradicts another one.
        """
        if name not in PARTS:
            self.next_start = self.next_start.with_setting(name, value)
        elif value == self._initial.get(name):
            wanted = self.wanted.with_part(name, self._initial)
            self.next_start = self.next_start.with_part(name, wanted)
        else:
            wanted = self.wanted.set(name, value)
            self._code = self._code.including(wanted)
            self.next_start = self.next_start.with_part(name, wanted)

    def change(self, name: str, value: str) -> None:
        """Change a setting that may change while the run goes on, a robot or a ball.

        Args:
            name: see `Change`.
            value: see `Change`.

        Raises:
            UserError: there is no such setting, robot or place, or the value is out of range.
        """
        if name not in EDITS:
            name = self.now.canonical_name(name)
        change = Change(self.step, name, value)
        if name in EDITS:
            edit(self.run, change)()
            self._show_edit()
        else:
            self._change_setting(name, value)
            # A setting that changes again before the next step had no effect in between.
            self.changes = [each for each in self.changes if each[:2] != change[:2]]
        self.changes.append(change)

    def _show_edit(self) -> None:
        """Let the latest snapshot have the robots that are alive now, where they are now."""
        _, state = self.run.arrays()
        latest = self.snapshots[-1]
        pose = self.run.poses()[:1].astype(latest.frames.pose.dtype)
        is_alive = np.asarray(state.swarm.is_alive)[:1]
        frames = replace(latest.frames, is_alive=is_alive, pose=pose)
        self.snapshots[-1] = latest._replace(frames=frames)

    def _change_setting(self, name: str, text: str) -> None:
        """Change a setting of the run, and of what waits if that has it, too; both or none."""
        config_before = self.now.config
        now = self.now.set(name, parsed(self.now, name, text))
        next_start = self.next_start.with_rule(now, name)
        task = None if is_same(now.task, self.now.task) else now.task
        self.run.change(now.config, now.strategy, task)
        self.now = now
        self.next_start = next_start
        if task is not None or now.config != config_before:
            self._follow_areas()

    def _follow_areas(self) -> None:
        """Take in areas on the floor that settings have moved, and complete the recording then.

        A recording has these areas from its start.
        """
        before = self.world.scene
        self.world = RecordedWorld.of_run(self.run, 0)
        if areas_differ(before, self.world.scene):
            self.stop_recording()

    def _append(self, frames: Frames, record: StepRecord) -> None:
        """Keep what the latest control step looks like."""
        self.snapshots.append(Snapshot(frames, record))
        arrays = frames.arrays()
        point = {}
        for name in ("step", *self.run.task.measured, "collisions", "mean_speed"):
            array = name if name in ARRAYS else METRIC + name
            point[name] = float(arrays[array][0])
        self._points.append(point)

    def values(self) -> dict[str, Any]:
        """Return the settings and changes that reproduce the run so far, by the names of flags.

        Raises:
            UserError: no flag can state one of them, or a file with the code that runs has changed.
        """
        self.check_code()
        values = self.start.values()
        if self.changes:
            return values | {"changes": tuple(str(change) for change in self.changes)}
        return values | {"steps": max(1, self.step)}

    def check_code(self) -> None:
        """Check that users' files still have the code that runs.

        Raises:
            UserError: one has changed since.
        """
        changed = self._running_code.changed_files(self.start)
        if changed:
            names = " and ".join(path.name for path in changed)
            raise UserError(f"{names} changed after the run began; Reset reads it again")

    @property
    def _subcommand(self) -> str:
        """Name of the command of `iswarm` that reproduces the run so far."""
        return "play" if self.changes else "run"

    def command(self) -> str:
        """Return a command that reproduces the run so far.

        It is `iswarm run`, or `iswarm play` where something changed.

        Raises:
            UserError: no flag can state one of its settings.
        """
        return command_line(self._subcommand, self.values())

    def toml(self) -> str:
        """Return a file for --config of that command.

        Raises:
            UserError: no key can state one of its settings.
        """
        return f"# iswarm {self._subcommand} --config FILE\n{toml(self.values())}"

    @property
    def is_recording(self) -> bool:
        """Control steps are added to a recording."""
        return self._recorder is not None

    def start_recording(self) -> None:
        """Record to a new file for Rerun, from the present state on, unless a recording goes on.

        Raises:
            UserError: there are too many recordings, or the file cannot be written.
        """
        if self.is_recording:
            return
        if self._n_recordings >= MOST_RECORDINGS:
            limit = f"this page has made {MOST_RECORDINGS} recordings, as many as it can"
            raise UserError(f"{limit}; start another page")
        self.out.mkdir(parents=True, exist_ok=True)
        numbers = itertools.count(1)
        path = next(path for path in map(self._recording_path, numbers) if not path.exists())

        # A recording begins with the record `start` of its run.
        run = copy.copy(self.run)
        run.start = self.snapshots[-1].record
        self._recorder = Recorder(run, path)
        self._n_recordings += 1
        self.recording = path

    def _recording_path(self, number: int) -> Path:
        """Return the path of a recording by its number."""
        return self.out / f"play-{number}.rrd"

    def stop_recording(self) -> None:
        """Complete the file; any thread may do so, also while a control step is computed.

        Where that fails, it is not tried again.
        """
        with self._recording_lock:
            recorder = self._recorder
            self._recorder = None
            if recorder is not None:
                recorder.save()


def _check_changes(scenario: PageScenario, changes: Sequence[Change]) -> None:
    """Check the settings that some changes state.

    Raises:
        UserError: there is no such setting, or a value is out of range.
    """
    for change in changes:
        if change.name not in EDITS:
            name = scenario.canonical_name(change.name)
            scenario = scenario.set(name, parsed(scenario, name, change.value))
