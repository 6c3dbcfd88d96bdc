"""Figures that tests look at instead of writing them."""

from contextlib import contextmanager

import matplotlib

from iswarm_mj.output.plot_style import STYLE, blank


def captured(monkeypatch, *modules):
    """Return a dictionary that functions of these modules fill: file name -> axes they draw."""
    axes = {}

    @contextmanager
    def unwritten(path, caption="", **more):
        with matplotlib.rc_context(STYLE):
            _, axes[path.name] = blank(**more)
            yield axes[path.name]

    for module in modules:
        monkeypatch.setattr(module, "figure", unwritten)
    return axes


def line(axes, label):
    """Return the points (n, 2) of the first line with a label."""
    return next(line.get_xydata() for line in axes.lines if line.get_label() == label)
