"""What robots said, as tables and recordings show it: the fields of their messages, in SI."""

import json
from collections.abc import Iterator
from typing import Any

import numpy as np
from jaxtyping import Shaped, UInt32

from iswarm_mj.output.schema import IN_FILES, Column, spoke
from iswarm_mj.output.trajectory import Scene
from iswarm_mj.sensors.fields import Field, Vector
from iswarm_mj.sensors.messages import PRIORITY, Payload, column_names

_PARTS = {"_x": "ahead, ", "_y": "left, ", "_hop": "hop count "}


def stored(payload: Payload) -> str:
    """Return a declaration as trajectories have it."""
    return json.dumps(payload.to_json())


def said(
    scene: Scene,
    messages: UInt32[np.ndarray, "T N"],
) -> Iterator[tuple[Column, Shaped[np.ndarray, "T N"]]]:
    """Yield the columns of the fields of messages, vectors by their parts, and their values, masked where none is.

    Args:
        scene: what they carry.
        messages: their bits.
    """
    payload = Payload.from_json(json.loads(scene.payload))
    values = payload.unpack(messages, int(scene.n_leds))[0].payload
    for name, field in payload.fields:
        for part, numbers in zip(column_names(name, field), _numbers(field, values[name]), strict=True):
            yield (
                Column(f"said_{part}", *_described(name, field, part.removeprefix(name)), spoke),
                numbers,
            )


def shown_fields(
    scene: Scene,
    messages: UInt32[np.ndarray, "T N"],
) -> dict[str, Shaped[np.ndarray, "T N"]]:
    """Return what recordings and the page show of messages beside their bits and `priority`: all fields but vectors.

    Args:
        scene: what they carry.
        messages: their bits.
    """
    fields = Payload.from_json(json.loads(scene.payload)).fields
    shown = {f"said_{name}" for name, field in fields if not isinstance(field, Vector) and name != PRIORITY}
    return {column.name: values for column, values in said(scene, messages) if column.name in shown} if shown else {}


def _numbers(field: Field, values: Any) -> list[np.ndarray]:
    factor = IN_FILES.get(field.unit, ("", 1.0))[1]
    if isinstance(field, Vector):
        x, y = np.moveaxis(factor * values.vector, -1, 0)
        return [np.ma.masked_where(~values.known, part) for part in (x, y, values.hop)]
    return [values if factor == 1.0 else factor * values]


def _described(name: str, field: Field, part: str) -> tuple[str, str]:
    """Unit and description of a part of a field."""
    unit = "" if part == "_hop" else IN_FILES.get(field.unit, (field.unit,))[0]
    if not part:
        return unit, "that the robot sent as the step began"
    return (
        unit,
        f"{_PARTS[part]}of the vector {name} that the robot sent as the step began, in its own frame",
    )
