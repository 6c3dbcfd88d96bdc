"""Sweeps from the page: runs of the present settings with several values of one of them."""

import itertools
import math
import subprocess
import sys
import time
from collections import Counter
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from iswarm_mj.player.controls import Control, controls, in_page_units
from iswarm_mj.player.inputs import Inputs
from iswarm_mj.player.scenario import PageScenario
from iswarm_mj.player.session import Session
from iswarm_mj.player.widgets import copyable, show
from iswarm_mj.simulation.scenario_flags import flag_words
from iswarm_mj.utils.constraints import Within, check
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.operating_system import own_group, shell_line

MOST_VALUES = 12
"""Largest number of values of a sweep."""
MOST_WORLDS = 32
"""Largest number of worlds for each value."""
MOST_STEPS = 2000
"""Largest number of control steps of a sweep's runs."""
CLOSE_S = 2.0
"""Time that a sweep has to end when its page is closed [s]."""
_NOT_SWEPT = ("seed",)
_LIST = "Runs of the present settings, with changes made so far, for several values of one of them."


class _Sweep(NamedTuple):
    """A sweep that was started and whose end was not shown yet."""

    process: "subprocess.Popen[Any]"
    out: Path
    """Folder of its results."""
    began: float
    """When it began, by the clock `time.monotonic` [s]."""


class SweepFolder:
    """Controls that start `iswarm sweep` as a command of its own, and what it found."""

    def __init__(self, gui: Any, inputs: Inputs, session: Session):
        """Add the controls to the present folder.

        Args:
            gui: panel of a viser server.
            inputs: inputs of the page.
            session: whose settings are swept.
        """
        self._gui = gui
        self._inputs = inputs
        self._session = session
        self._sweep: _Sweep | None = None
        self._figure: Any = None

        gui.add_markdown(_LIST)
        labels = tuple(swept_by_label(session.now))
        setting = Control("setting", "", labels[0], choices=labels)
        self._label = inputs.add(setting, lambda _: self._propose_range())
        self._low = inputs.add(Control("from", "", 0.0))
        self._high = inputs.add(Control("to", "", 1.0))
        self._n_values = inputs.add(Control("values", "", 5, limits=Within(2, MOST_VALUES)))
        self._n_worlds = inputs.add(Control("worlds", "", 4, limits=Within(1, MOST_WORLDS)))
        self._n_steps = inputs.add(Control("steps", "", 300, limits=Within(1, MOST_STEPS)))
        inputs.add_button("Run the sweep", lambda _: session.post(self._start), icon="chart-line")
        self._stop = inputs.add_button("Stop the sweep", lambda _: self.stop(), icon="player-stop")
        self._state = gui.add_markdown("")
        self._command = gui.add_html("")
        self._results = gui.add_folder("Result", visible=False)
        self._propose_range()

    def rebuild(self) -> None:
        """Offer the settings of a run that begins."""
        labels = tuple(swept_by_label(self._session.now))
        if tuple(self._label.options) != labels:
            self._inputs.offer(self._label, labels)
            self._propose_range()

    def _propose_range(self) -> None:
        """Show the range of the setting, or half to twice its value where it has none."""
        control = swept_by_label(self._session.now)[self._label.value]
        low, high = control.low, control.high
        if not (math.isfinite(low) and math.isfinite(high) and high <= 100):
            low, high = sorted((control.value / 2, control.value * 2 or 1.0))
        show(self._low, "value", float(low))
        show(self._high, "value", float(high))

    def _start(self) -> None:
        """Start the sweep; the thread of the session calls this.

        Raises:
            UserError: one is running, the range is empty, no flag states a setting of the run, or
                a run of other settings has begun.
        """
        if self._sweep is not None:
            raise UserError("a sweep is running; wait for it, or stop it")
        session = self._session
        session.check_code()
        low, high = float(self._low.value), float(self._high.value)
        check("to", high, f"above from, {low:g}", low < high)
        control = swept_by_label(session.now).get(self._label.value)
        if control is None:
            raise UserError("another run has begun; choose the setting again")

        values = np.linspace(low, high, int(self._n_values.value))
        words = sweep_words(
            session.now,
            control.name,
            np.array([control.of_setting(value) for value in values.tolist()]),
            n_worlds=int(self._n_worlds.value),
            n_steps=int(self._n_steps.value),
        )
        out = _new_folder(session.out)
        words += ["--out", str(out)]
        with _log_of(out).open("w") as log:  # a pipe that nobody reads would block at 64 KB
            process = subprocess.Popen(
                [sys.executable, "-P", "-m", "iswarm_mj", *words],  # nothing of the user's folder
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=log,
                **own_group(),
            )
        self._sweep = _Sweep(process, out, time.monotonic())
        show(self._command, "content", copyable(shell_line(["iswarm", *words])))

    def update(self) -> None:
        """Show how the sweep gets on, and its figure once it is complete."""
        sweep = self._sweep
        is_running = sweep is not None and sweep.process.poll() is None
        show(self._stop, "visible", is_running)
        if sweep is None:
            return
        if is_running:
            seconds = time.monotonic() - sweep.began
            show(self._state, "content", f"The sweep runs, since {seconds:.0f} s.")
            return
        try:
            self._show_end(sweep)
        finally:
            self._sweep = None  # last, as another one may begin from now on

    def _show_end(self, sweep: "_Sweep") -> None:
        """Show the figure of a sweep that has ended, or why there is none."""
        log = _log_of(sweep.out)
        lines = log.read_text(errors="replace").strip().splitlines()
        log.unlink()
        if sweep.process.returncode:
            reason = lines[-1] if lines else "it was stopped"
            show(self._state, "content", f"The sweep ended: {reason}")
            return
        show(self._state, "content", f"Table and figure: `{sweep.out}`.")
        self._show_figure(sweep.out / "sweep.png")

    def _show_figure(self, path: Path) -> None:
        """Show the figure of the sweep."""
        from matplotlib.image import imread

        pixels = np.rint(255 * imread(path)[..., :3]).astype(np.uint8)
        self._results.visible = True
        if self._figure is None:
            with self._results:
                self._figure = self._gui.add_image(pixels, label=path.parent.name)
        else:
            self._figure.image = pixels

    def stop(self) -> None:
        """End the sweep, if one runs; its complete runs are kept."""
        sweep = self._sweep
        if sweep is not None and sweep.process.poll() is None:
            sweep.process.terminate()

    def close(self) -> None:
        """End the sweep, if one runs, and wait for its end."""
        self.stop()
        sweep = self._sweep
        if sweep is None:
            return
        try:
            sweep.process.wait(CLOSE_S)
        except subprocess.TimeoutExpired:
            sweep.process.kill()
        _log_of(sweep.out).unlink(missing_ok=True)


def _new_folder(parent: Path) -> Path:
    """Return a new folder for a sweep; no two pages get the same one."""
    parent.mkdir(parents=True, exist_ok=True)
    for number in itertools.count(1):
        folder = parent / f"sweep-{number}"
        with suppress(FileExistsError):
            folder.mkdir()
            return folder
    raise AssertionError  # numbers do not end


def _log_of(out: Path) -> Path:
    """Return the file of the messages of a sweep while it runs."""
    return out.with_suffix(".log")


def swept_by_label(scenario: PageScenario) -> dict[str, Control]:
    """Return the controls of settings that can be swept, in units of the page, by their labels.

    Labels that several settings have state their groups, too.
    """
    swept = [in_page_units(control) for control in swept_settings(scenario).values()]
    numbers = Counter(control.label for control in swept)
    by_label = {}
    for control in swept:
        is_unique = numbers[control.label] == 1
        by_label[control.label if is_unique else f"{control.group}: {control.label}"] = control
    return by_label


def swept_settings(scenario: PageScenario) -> dict[str, Control]:
    """Return the controls of the settings that can be swept, those that are numbers, by name."""
    swept = {}
    for control in controls(scenario):
        is_number = isinstance(control.value, int | float) and not isinstance(control.value, bool)
        if is_number and not control.choices and control.name not in _NOT_SWEPT:
            swept[control.name] = control
    return swept


def sweep_words(
    scenario: PageScenario, name: str, values: np.ndarray, *, n_worlds: int, n_steps: int
) -> list[str]:
    """Return the words of the command that sweeps a setting of a scenario, without `iswarm`.

    Args:
        scenario: settings of the runs.
        name: setting that is swept.
        values: its values; whole ones where the setting is a whole number.
        n_worlds: number of worlds for each value.
        n_steps: largest number of control steps.

    Raises:
        UserError: no flag states a setting of the scenario.
    """
    is_whole = isinstance(swept_settings(scenario)[name].value, int)
    if is_whole:
        texts = [str(number) for number in np.unique(np.rint(values).astype(int))]
    else:
        texts = [f"{number:.6g}" for number in values]
    flags = scenario.values() | {"worlds": n_worlds, "steps": n_steps}
    flags.pop(name, None)
    words = flag_words(flags)
    flag = name.replace("_", "-")
    return ["sweep", "run", *words, "--over", f"{flag}={','.join(texts)}"]
