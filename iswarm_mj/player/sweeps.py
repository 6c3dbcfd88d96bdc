"""Sweeps from the page: runs of the present settings with several values of one of them."""

import itertools
import math
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

from iswarm_mj.player.controls import Control, controls
from iswarm_mj.player.inputs import Inputs
from iswarm_mj.player.scenario import PageScenario
from iswarm_mj.player.session import Session
from iswarm_mj.player.widgets import copyable, show
from iswarm_mj.simulation.scenario_flags import flag_words
from iswarm_mj.utils.constraints import Within, check
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.operating_system import shell_line

MOST_VALUES = 12
"""Largest number of values of a sweep."""
MOST_WORLDS = 32
"""Largest number of worlds for each value."""
MOST_STEPS = 2000
"""Largest number of control steps of a sweep's runs."""
_NOT_SWEPT = ("seed",)
_LIST = "Runs of the present settings, with changes made so far, for several values of one of them."


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
        self._process: subprocess.Popen[bytes] | None = None
        self._began = 0.0
        self._out = Path()
        self._figure: Any = None

        gui.add_markdown(_LIST)
        swept = tuple(swept_settings(session.now))
        name = Control("setting", "", swept[0], choices=swept)
        self._name = inputs.add(name, lambda _: self._propose_range())
        self._low = inputs.add(Control("from", "", 0.0))
        self._high = inputs.add(Control("to", "", 1.0))
        self._n_values = inputs.add(Control("values", "", 5, limits=Within(2, MOST_VALUES)))
        self._n_worlds = inputs.add(Control("worlds", "", 4, limits=Within(1, MOST_WORLDS)))
        self._n_steps = inputs.add(Control("steps", "", 300, limits=Within(1, MOST_STEPS)))
        inputs.add_button("Run the sweep", lambda _: self._start(), icon="chart-line")
        self._stop = inputs.add_button("Stop the sweep", lambda _: self.stop(), icon="player-stop")
        self._state = gui.add_markdown("")
        self._command = gui.add_html("")
        self._results = gui.add_folder("Result", visible=False)
        self._propose_range()

    def rebuild(self) -> None:
        """Offer the settings of a run that begins."""
        swept = tuple(swept_settings(self._session.now))
        if tuple(self._name.options) != swept:
            self._inputs.offer(self._name, swept)
            self._propose_range()

    def _propose_range(self) -> None:
        """Show the range of the setting, or half to twice its value where it has none."""
        control = swept_settings(self._session.now)[self._name.value]
        low, high = control.low, control.high
        if not (math.isfinite(low) and math.isfinite(high) and high <= 100):
            low, high = sorted((control.value / 2, control.value * 2 or 1.0))
        show(self._low, "value", float(low))
        show(self._high, "value", float(high))

    def _start(self) -> None:
        """Start the sweep.

        Raises:
            UserError: one is running, the range is empty, or no flag states a setting of the run.
        """
        if self._process is not None:
            raise UserError("a sweep is running; wait for it, or stop it")
        low, high = float(self._low.value), float(self._high.value)
        check("to", high, f"above from, {low:g}", low < high)
        now = self._session.now
        numbers = itertools.count(1)
        folder = self._session.out
        self._out = next(p for p in (folder / f"sweep-{n}" for n in numbers) if not p.exists())
        words = sweep_words(
            now,
            self._name.value,
            np.linspace(low, high, int(self._n_values.value)),
            n_worlds=int(self._n_worlds.value),
            n_steps=int(self._n_steps.value),
        )
        words += ["--out", str(self._out)]
        folder.mkdir(parents=True, exist_ok=True)
        with self._log.open("w") as log:  # a pipe that nobody reads would block at 64 KB
            self._process = subprocess.Popen(
                [sys.executable, "-m", "iswarm_mj", *words],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=log,
            )
        self._began = time.monotonic()
        show(self._command, "content", copyable(shell_line(["iswarm", *words])))

    def update(self) -> None:
        """Show how the sweep gets on, and its figure once it is complete."""
        process = self._process
        is_running = process is not None and process.poll() is None
        show(self._stop, "visible", is_running)
        if process is None:
            return
        if is_running:
            seconds = time.monotonic() - self._began
            show(self._state, "content", f"The sweep runs, since {seconds:.0f} s.")
            return
        self._process = None
        lines = self._log.read_text(errors="replace").strip().splitlines()
        self._log.unlink()
        if process.returncode:
            reason = lines[-1] if lines else "it was stopped"
            show(self._state, "content", f"The sweep ended: {reason}")
            return
        show(self._state, "content", f"Table and figure: `{self._out}`.")
        self._show_figure(self._out / "sweep.png")

    @property
    def _log(self) -> Path:
        """File of the messages of the sweep while it runs."""
        return self._out.with_suffix(".log")

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
        process = self._process
        if process is not None and process.poll() is None:
            process.terminate()


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
    numbers = np.unique(np.rint(values).astype(int)) if is_whole else values
    texts = ",".join(f"{number:.6g}" for number in numbers)
    flags = scenario.values() | {"worlds": n_worlds, "steps": n_steps}
    flags.pop(name, None)
    words = flag_words(flags)
    flag = name.replace("_", "-")
    return ["sweep", "run", *words, "--over", f"{flag}={texts}"]
