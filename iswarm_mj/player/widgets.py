"""Parts of the panel: a control as an input of viser, a legend, a command that can be copied."""

import html
import math
from typing import Any

import numpy as np

from iswarm_mj.output.palette import Rgb
from iswarm_mj.player.controls import Control

_LINE = {"stroke": "rgba(128,128,128,.4)", "width": 1}
AXIS = {"stroke": "#888", "grid": _LINE, "ticks": _LINE}
"""Of a plot, visible on a light and on a dark page."""
_WIDEST = 400.0
"""Range that a slider can show."""


def widget(gui: Any, control: Control) -> Any:
    """Return an input for a control: a choice, a box to tick, a slider, or a number where the range is wide.

    Args:
        gui: of a viser server.
        control: a setting.
    """
    label, value, hint = control.label, control.value, control.text or None
    if control.choices:
        return gui.add_dropdown(label, control.choices, initial_value=value, hint=hint)
    if isinstance(value, bool):
        return gui.add_checkbox(label, value, hint=hint)

    is_whole = isinstance(value, int)
    if control.high - control.low <= _WIDEST:
        step = control.step or (1 if is_whole else (control.high - control.low) / 200)
        return gui.add_slider(label, control.low, control.high, step, value, hint=hint)
    low = None if math.isinf(control.low) else control.low
    high = None if math.isinf(control.high) else control.high
    step = 1 if is_whole else 10.0 ** math.floor(math.log10(abs(value) or 1.0) - 1)
    return gui.add_number(label, value, min=low, max=high, step=step, hint=hint)


def show(handle: Any, name: str, value: Any) -> None:
    """Change what a control or a node of viser shows, unless it shows that."""
    if not np.array_equal(getattr(handle, name), value):
        setattr(handle, name, value)


def spots(entries: list[tuple[str, Rgb]], title: str = "") -> str:
    """Return a legend of labels and colours after a title, in HTML."""
    found = "".join(
        f'<span style="white-space:nowrap;margin-right:.8em"><span style="display:inline-block;width:.8em;height:.8em;'
        f'border-radius:2px;margin-right:.3em;background:rgb{colour}"></span>{html.escape(label)}</span> '
        for label, colour in entries
        if label
    )
    return f'<div style="font-size:.8em;line-height:1.6;padding:.3em .8em"><b>{html.escape(title)}</b> {found}</div>'


def copied(text: str) -> str:
    """A command with a button that copies it."""
    copy = "navigator.clipboard.writeText(this.previousElementSibling.textContent);this.textContent='Copied'"
    style = "white-space:pre-wrap;word-break:break-word;font-size:.8em;margin:0 0 .4em;padding:.5em;border-radius:4px"
    shown = f'<pre style="{style};background:rgba(128,128,128,.15)">{html.escape(text)}</pre>'
    button = f'<button onclick="{copy}" style="cursor:pointer;padding:.2em .8em">Copy</button>'
    return f'<div style="padding:.3em .8em">{shown}{button}</div>'
