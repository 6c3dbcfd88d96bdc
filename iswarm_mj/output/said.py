"""What robots said, as tables and recordings show it: the fields of their messages, in SI."""

import json
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from iswarm_mj.sensors.fields import Field, Vector
from iswarm_mj.sensors.memory import VectorMemory
from iswarm_mj.sensors.messages import PRIORITY, Payload, columns
from iswarm_mj.strategy.vector_strategy import payload_for
from iswarm_mj.utils.units import MM

IN_FILES = {"mm": ("m", MM), "mm/s": ("m/s", MM)}
"""Units of the model, what they become in files, and the factor."""


class Said(NamedTuple):
    """A number or a flag of the robots' messages."""

    values: Any
    """(T, N), masked where there is none."""
    unit: str
    description: str


def stored(payload: Payload) -> str:
    """Return a declaration as trajectories have it."""
    return json.dumps(payload.to_json())


def payload_of(arrays: Mapping[str, Any]) -> Payload:
    """Return what the messages of a trajectory carry; of versions that did not state it, those of vectors."""
    if "scene_payload" in arrays:
        return Payload.from_json(json.loads(str(arrays["scene_payload"])))
    return payload_for(float(arrays.get("scene_message_range", 1.0)) / MM, int(arrays.get("scene_n_leds", 4)))


def names_of(payload: Payload) -> dict[str, tuple[str, str]]:
    """Return names, units and descriptions of what `said` returns."""
    return {
        part: (_unit(name, field, part), _description(name, part))
        for name, field in payload.fields
        for part in columns(name, field)
    }


def said(payload: Payload, n_leds: int, messages: np.ndarray) -> dict[str, Said]:
    """Return the fields of messages, vectors by their parts, by the names of `messages.columns`.

    Args:
        payload: what they carry.
        n_leds: LEDs of a robot.
        messages: (T, N) of 32 bits.
    """
    values, about = payload.unpack(messages, n_leds)[0].payload, names_of(payload)
    parts = [part for name, field in payload.fields for part in _parts(field, values[name])]
    return {name: Said(part, *about[name]) for name, part in zip(about, parts, strict=True)}


def readable(payload: Payload, n_leds: int, messages: np.ndarray) -> dict[str, np.ndarray]:
    """Return what recordings show of messages beside their bits and `priority`: all fields but vectors.

    Args:
        payload: what they carry.
        n_leds: LEDs of a robot.
        messages: (T, N) of 32 bits.
    """
    shown = {name for name, field in payload.fields if not isinstance(field, Vector) and name != PRIORITY}
    if not shown:
        return {}
    return {f"said_{name}": part.values for name, part in said(payload, n_leds, messages).items() if name in shown}


def _parts(field: Field, values: Any) -> list[np.ndarray]:
    factor = IN_FILES.get(field.unit, ("", 1.0))[1]
    if isinstance(values, VectorMemory):
        x, y = np.moveaxis(factor * values.vector, -1, 0)
        each = (x, y, values.hop)
        return [np.ma.masked_where(~values.known, part) for part in each]
    return [values if factor == 1.0 else factor * values]


def _unit(name: str, field: Field, part: str) -> str:
    return "" if part == f"{name}_hop" else IN_FILES.get(field.unit, (field.unit,))[0]


def _description(name: str, part: str) -> str:
    which = {"_x": "ahead, ", "_y": "left, ", "_hop": "hop count "}
    if part == name:
        return "that the robot sent as the step began"
    where = f"of the vector {name} that the robot sent as the step began, in its own frame"
    return which[part.removeprefix(name)] + where
