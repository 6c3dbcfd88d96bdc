"""What robots said, as tables and recordings show it: the fields of their messages, in SI."""

import json
from typing import Any

import numpy as np
from jaxtyping import Shaped, UInt32

from iswarm_mj.output.schema import IN_FILES, Column, spoke
from iswarm_mj.sensors.fields import Field, Vector
from iswarm_mj.sensors.memory import VectorMemory
from iswarm_mj.sensors.messages import PRIORITY, Payload, columns


def stored(payload: Payload) -> str:
    """Return a declaration as trajectories have it."""
    return json.dumps(payload.to_json())


def payload_of(stated: str) -> Payload:
    """Return the declaration that `stored` gave."""
    return Payload.from_json(json.loads(stated))


def message_columns(payload: Payload) -> list[Column]:
    """Return the columns of the fields of messages, vectors by their parts; their names are those in `decoded`."""
    return [
        Column(part, *_described(name, field, part), spoke)
        for name, field in payload.fields
        for part in columns(name, field)
    ]


def decoded(payload: Payload, n_leds: int, messages: UInt32[np.ndarray, "T N"]) -> dict[str, Shaped[np.ndarray, "T N"]]:
    """Return the values of the fields of messages, masked where there is none.

    Args:
        payload: what they carry.
        n_leds: LEDs of a robot.
        messages: their bits.
    """
    values, found = payload.unpack(messages, n_leds)[0].payload, {}
    for name, field in payload.fields:
        found |= zip(columns(name, field), _parts(field, values[name]), strict=True)
    return found


def shown_fields(payload: Payload, n_leds: int, messages: UInt32[np.ndarray, "T N"]) -> dict[str, np.ndarray]:
    """Return what recordings show of messages beside their bits and `priority`: all fields but vectors.

    Args:
        payload: what they carry.
        n_leds: LEDs of a robot.
        messages: their bits.
    """
    shown = [name for name, field in payload.fields if not isinstance(field, Vector) and name != PRIORITY]
    values = decoded(payload, n_leds, messages) if shown else {}
    return {f"said_{name}": values[name] for name in shown}


def _parts(field: Field, values: Any) -> list[np.ndarray]:
    factor = IN_FILES.get(field.unit, ("", 1.0))[1]
    if isinstance(values, VectorMemory):
        x, y = np.moveaxis(factor * values.vector, -1, 0)
        return [np.ma.masked_where(~values.known, part) for part in (x, y, values.hop)]
    return [values if factor == 1.0 else factor * values]


def _described(name: str, field: Field, part: str) -> tuple[str, str]:
    """Unit and description of a part of a field."""
    unit = IN_FILES.get(field.unit, (field.unit,))[0]
    if part == name:
        return unit, "that the robot sent as the step began"
    which = {"_x": "ahead, ", "_y": "left, ", "_hop": "hop count "}[part.removeprefix(name)]
    text = f"{which}of the vector {name} that the robot sent as the step began, in its own frame"
    return "" if part == f"{name}_hop" else unit, text
