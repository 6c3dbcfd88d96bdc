"""Figures that are looked at, and not written."""

from contextlib import contextmanager

import matplotlib

from iswarm_mj.output.plot_style import STYLE, blank


def captured(monkeypatch, *modules):
    """Axes by the names of their files, of what functions of these modules draw."""
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
    """Points (n, 2) of the first line with a label."""
    return next(line.get_xydata() for line in axes.lines if line.get_label() == label)
