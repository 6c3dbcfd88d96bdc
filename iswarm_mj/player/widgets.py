"""Parts of the panel: a control as an input of viser, a legend, a command that can be copied."""

import html
import math
from typing import Any

import numpy as np

from iswarm_mj.output.legend import Group
from iswarm_mj.output.palette import Rgb
from iswarm_mj.player.controls import Control

_LINE = {"stroke": "rgba(128,128,128,.4)", "width": 1}
AXIS = {"stroke": "#888", "grid": _LINE, "ticks": _LINE}
"""Axis of a plot, visible on a light and on a dark page."""
_WIDEST = 400.0
"""Widest range for which an input is a slider."""


def widget(gui: Any, control: Control) -> Any:
    """Return an input for a control.

    That is a choice, a box to tick, a slider, or a number where the range is wide.

    Args:
        gui: panel of a viser server.
        control: setting that the input shows.
    """
    label = control.label
    value = control.value
    hint = control.text or None
    if control.choices:
        return gui.add_dropdown(label, control.choices, initial_value=value, hint=hint)
    if isinstance(value, bool):
        return gui.add_checkbox(label, value, hint=hint)
    if control.high - control.low <= _WIDEST:
        step = _slider_step(control)
        return gui.add_slider(label, control.low, control.high, step, value, hint=hint)
    low = None if math.isinf(control.low) else control.low
    high = None if math.isinf(control.high) else control.high
    step = _number_step(control)
    return gui.add_number(label, value, min=low, max=high, step=step, hint=hint)


def _slider_step(control: Control) -> float:
    """Return the least difference of values on a slider."""
    if control.step:
        return control.step
    if isinstance(control.value, int):
        return 1
    return (control.high - control.low) / 200


def _number_step(control: Control) -> float:
    """Return by how much the arrows of a number change it: about a tenth."""
    if isinstance(control.value, int):
        return 1
    return 10.0 ** math.floor(math.log10(abs(control.value) or 1.0) - 1)


def save(client: Any, name: str, content: bytes) -> None:
    """Let a browser save a file at once, in its folder of downloads."""
    client.send_file_download(name, content, save_immediately=True)


def show(handle: Any, name: str, value: Any) -> None:
    """Change what a control or a node of viser shows, unless it shows that."""
    if not np.array_equal(getattr(handle, name), value):
        setattr(handle, name, value)


def warning(sentence: str) -> str:
    """Return a sentence on a refused value, in HTML that is legible on light and dark pages."""
    style = "font-size:.75em;line-height:1.35;color:#e8590c;padding:0 .8em .3em"
    return f'<div style="{style}">{html.escape(sentence)}</div>'


def spots(legend: list[Group], title: str = "") -> str:
    """Return a legend after a title, in HTML: a line of colours and labels for each heading."""
    lines = [f"<b>{html.escape(title)}</b>"] if title else []
    for heading, entries in legend:
        labels = "".join(_spot(label, colour) for label, colour in entries)
        lines.append(f'<span style="opacity:.7">{html.escape(heading)}:</span> {labels}')
    style = "font-size:.8em;line-height:1.6;padding:.3em .8em"
    return f'<div style="{style}">{"<br>".join(lines)}</div>'


def _spot(label: str, colour: Rgb) -> str:
    """Return a coloured square and a label, in HTML."""
    square = (
        "display:inline-block;width:.8em;height:.8em;border-radius:2px;margin-right:.3em;"
        "box-shadow:0 0 0 1px rgba(128,128,128,.6)"  # else black is invisible on a dark page
    )
    return (
        f'<span style="white-space:nowrap;margin-right:.8em">'
        f'<span style="{square};background:rgb{colour}"></span>{html.escape(label)}</span> '
    )


def copyable(text: str) -> str:
    """Return a command with a button that copies it, in HTML."""
    style = (
        "white-space:pre-wrap;word-break:break-word;font-size:.8em;margin:0 0 .4em;padding:.5em;"
        "border-radius:4px;background:rgba(128,128,128,.15)"
    )
    take = "navigator.clipboard.writeText(this.previousElementSibling.textContent)"
    copy = f"{take};this.textContent='Copied'"
    command = f'<pre style="{style}">{html.escape(text)}</pre>'
    button = f'<button onclick="{copy}" style="cursor:pointer;padding:.2em .8em">Copy</button>'
    return f'<div style="padding:.3em .8em">{command}{button}</div>'
