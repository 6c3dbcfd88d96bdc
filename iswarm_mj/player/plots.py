"""The plots of the page: metrics over the control steps, which can be saved as CSV and PNG."""

import csv
import io
from collections.abc import Mapping
from typing import Any

import numpy as np

from iswarm_mj.output.palette import BLUE
from iswarm_mj.player.inputs import Inputs
from iswarm_mj.player.session import Session
from iswarm_mj.player.widgets import AXIS, save, show

_UNITS = {"mean_speed": "m/s"}
"""Units of what each run measures; those of a task's metrics are the scene's."""


class Plots:
    """A plot for each metric of a session, in a folder."""

    def __init__(self, gui: Any, inputs: Inputs, session: Session):
        """Add the folder, with buttons that save what the plots show.

        Args:
            gui: panel of a viser server, within the tab of the plots.
            inputs: inputs of the page.
            session: whose metrics are plotted.
        """
        self._gui = gui
        self._session = session
        self._plots: dict[str, Any] = {}
        self._drawn: tuple[int, int] | None = None
        self._folder = gui.add_folder("Plots over control steps")
        with self._folder:
            look = {"icon": "download", "visible": False}  # until there is a plot
            self._buttons = (
                inputs.add_button("Save plots as CSV", self._save_csv, **look),
                inputs.add_button("Save plots as PNG", self._save_png, **look),
            )

    def rebuild(self) -> None:
        """Remove the plots if a run begins whose task has other metrics."""
        # viser keeps each removal for ever, so plots that still have a metric stay.
        if self._plots.keys() - self._session.lines.keys():
            for plot in self._plots.values():
                plot.remove()
            self._plots = {}

    def update(self) -> None:
        """Plot each metric once there are two control steps, if there is a new one."""
        session = self._session
        step = (session.version, session.step)
        if step == self._drawn:
            return
        self._drawn = step
        lines = session.lines
        steps = np.array(lines.pop("step"))
        for name, values in lines.items():
            data = (steps, np.array(values))
            if name in self._plots:
                self._plots[name].data = data
            elif len(steps) > 1:
                with self._folder:
                    self._plots[name] = self._add_plot(name, data)
        for button in self._buttons:
            show(button, "visible", bool(self._plots))

    def _add_plot(self, name: str, data: tuple[np.ndarray, np.ndarray]) -> Any:
        """Add the plot of a metric, without a legend."""
        line = {"label": name, "stroke": BLUE, "width": 2, "points": {"show": False}}
        return self._gui.add_uplot(
            data,
            ({"label": "step"}, line),
            title=name.replace("_", " "),
            scales={"x": {"time": False}},
            legend={"show": False},
            axes=(AXIS, AXIS),
            height=130,
        )

    def _save_csv(self, client: Any) -> None:
        """Let a browser save all plots as a table."""
        save(client, "plots.csv", csv_of(self._session.lines, self._units()))

    def _save_png(self, client: Any) -> None:
        """Let a browser save all plots as a picture; the session's thread draws it."""
        lines = self._session.lines
        units = self._units()
        self._session.post(lambda: save(client, "plots.png", png_of(lines, units)))

    def _units(self) -> dict[str, str]:
        """Return the units of the metrics that have one."""
        scene = self._session.scene
        return _UNITS | dict(zip(scene.metric_names, scene.metric_units, strict=True))


def csv_of(lines: Mapping[str, list[float]], units: Mapping[str, str]) -> bytes:
    """Return metrics as a table in CSV with a row for each control step.

    Args:
        lines: values by the names of metrics, and `step`.
        units: units of the metrics that have one, which stand in brackets behind the name.
    """
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow([_title(name, units) for name in lines])
    for row in zip(*lines.values(), strict=True):
        table.writerow([f"{value:.9g}" for value in row])
    return text.getvalue().encode()


def png_of(lines: Mapping[str, list[float]], units: Mapping[str, str]) -> bytes:
    """Return a picture with a plot of each metric, for arguments as of `csv_of`."""
    import matplotlib

    from iswarm_mj.output.plot_style import STYLE, blank

    names = [name for name in lines if name != "step"]
    picture = io.BytesIO()
    with matplotlib.rc_context(STYLE):
        drawing, axes = blank(rows=len(names), size=(6.0, 1.8))
        for name, plot in zip(names, axes, strict=True):
            plot.plot(lines["step"], lines[name], color=BLUE)
            plot.set_ylabel(_title(name, units).replace("_", " "))
        axes[-1].set_xlabel("control step")
        drawing.savefig(picture, format="png")
    return picture.getvalue()


def _title(name: str, units: Mapping[str, str]) -> str:
    """Return the name of a metric with its unit, if it has one."""
    unit = units.get(name, "")
    return f"{name} [{unit}]" if unit else name
