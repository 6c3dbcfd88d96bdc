"""Columns of tables and recordings with the fields of the robots' messages, in SI."""

import json
from collections.abc import Iterator
from typing import Any

import numpy as np
from jaxtyping import Shaped, UInt32

from iswarm_mj.output.schema import FILE_UNITS, Column, spoke
from iswarm_mj.output.trajectory import Scene
from iswarm_mj.sensors.fields import Field, Vector
from iswarm_mj.sensors.messages import PRIORITY, Payload, column_names

MESSAGE_PREFIX = "said_"
"""Prefix of the columns of message fields."""
_VECTOR_PARTS = {"_x": "ahead, ", "_y": "left, ", "_hop": "hop count "}
"""Beginning of the description of each part of a vector, by the suffix of its column."""


def payload_json(payload: Payload) -> str:
    """Return the fields of messages as JSON, as trajectories hold them."""
    return json.dumps(payload.to_json())


def payload_of(scene: Scene) -> Payload:
    """Return the fields of the messages of a scene."""
    return Payload.from_json(json.loads(scene.payload))


def message_columns(
    scene: Scene, messages: UInt32[np.ndarray, "T N"]
) -> Iterator[tuple[Column, Shaped[np.ndarray, "T N"]]]:
    """Yield the columns of the fields of messages with their values, for vectors one for each part.

    Values are masked where a message has no vector.

    Args:
        scene: constants of the world, which declare the fields.
        messages: bits of the messages.
    """
    payload = payload_of(scene)
    values = payload.unpack(messages, int(scene.n_leds))[0].payload
    for name, field in payload.fields:
        names_of_parts = column_names(name, field)
        for column_name, numbers in zip(names_of_parts, _numbers(field, values[name]), strict=True):
            suffix = column_name.removeprefix(name)
            column = Column(
                name=MESSAGE_PREFIX + column_name,
                unit=_unit_of(field, suffix),
                description=_description_of(name, suffix),
                known=spoke,
            )
            yield column, numbers


def shown_fields(
    scene: Scene, messages: UInt32[np.ndarray, "T N"]
) -> dict[str, Shaped[np.ndarray, "T N"]]:
    """Return the fields that recordings and the page show, by the names of their columns.

    Vectors are left out, and `priority`, which they show otherwise.

    Args:
        scene: constants of the world, which declare the fields.
        messages: bits of the messages.
    """
    names = set()
    for name, field in payload_of(scene).fields:
        if not isinstance(field, Vector) and name != PRIORITY:
            names.add(MESSAGE_PREFIX + name)
    if not names:  # most messages have vectors only, and decoding takes time
        return {}
    return {
        column.name: values
        for column, values in message_columns(scene, messages)
        if column.name in names
    }


def _numbers(field: Field, values: Any) -> list[np.ndarray]:
    """Return the values of a field in SI, for a vector one array for each part."""
    _, factor = FILE_UNITS.get(field.unit, ("", 1.0))
    if isinstance(field, Vector):
        x, y = np.moveaxis(factor * values.vector, -1, 0)
        return [np.ma.masked_where(~values.known, part) for part in (x, y, values.hop)]
    if factor == 1.0:
        return [values]  # with its own type, as of flags
    return [factor * values]


def _unit_of(field: Field, suffix: str) -> str:
    """Return the unit of a column of a field."""
    if suffix == "_hop":
        return ""
    return FILE_UNITS.get(field.unit, (field.unit, 1.0))[0]


def _description_of(name: str, suffix: str) -> str:
    """Return the description of a column of a field."""
    if not suffix:
        return "that the robot sent as the step began"
    part = _VECTOR_PARTS[suffix]
    return f"{part}of the vector {name} that the robot sent as the step began, in its own frame"
