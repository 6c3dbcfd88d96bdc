"""Tables of trajectories made by hand: columns that strategies and tasks name as others are called."""

import numpy as np
import pytest
from support.recorded import arrays, scene
from support.sensing import remember

from iswarm_mj.output.message_columns import payload_json
from iswarm_mj.output.tables import make_table
from iswarm_mj.output.trajectory import METRIC
from iswarm_mj.sensors.fields import Flag, Integer, Real, Vector
from iswarm_mj.sensors.messages import Message, Payload


def test_what_a_strategy_records_as_a_column_is_called_gets_another_name():
    """`x` and `world` are columns, and `home_0` is of a vector without a flag before there is a `home_0`."""
    made, values = arrays(), np.arange(12.0).reshape(3, 4)
    names, sizes = ["x", "world", "home", "home_0", "memory_x"], [1, 1, 2, 1, 1]
    for number, (name, size) in enumerate(zip(names, sizes, strict=True)):
        each = [values + 100 * number + 50 * place for place in range(size)]
        made[name] = each[0] if size == 1 else np.stack(each, axis=-1)
    about = scene()._replace(memory_names=names, memory_units=["", "", "m", "", ""], memory_sizes=sizes, world=7)
    table = make_table("robots", made, about)
    assert len(set(table.column_names)) == len(table.column_names)
    np.testing.assert_array_equal(table["x"].to_numpy(), made["pose"][..., 0].ravel())
    assert set(table["world"].to_pylist()) == {7}
    own = {"memory_x": 0, "memory_world": 100, "home_0": 200, "home_1": 250, "memory_home_0": 300}
    for name, first in (own | {"memory_memory_x": 400}).items():
        np.testing.assert_array_equal(table[name].to_numpy(), values.ravel() + first)


def test_what_a_strategy_records_and_says_under_one_name():
    """Both are there; robots said 3 in the first step and remember 9."""
    payload = Payload({"count": Integer(bits=4)})
    word = np.asarray(payload.pack(Message(np.int32(0), {"count": np.int32(3)}), 4))
    made = arrays() | {"message": np.full((3, 4), word, np.uint32), "said_count": np.full((3, 4), 9)}
    own = {"memory_names": ["said_count"], "memory_units": [""], "memory_sizes": [1], "payload": payload_json(payload)}
    table = make_table("robots", made, scene()._replace(**own))
    assert table["said_count"].to_pylist() == [None] * 4 + [3] * 8
    assert table["memory_said_count"].to_pylist() == [9] * 12


def test_lengths_that_robots_say_are_in_metres():
    """20 mm to the left, of at most 62 in 31 steps; 5 mm deep."""
    payload = Payload({"home": Vector(62.0), "depth": Real(0, 7, bits=3, unit="mm")})
    said = {"home": remember([0.0, 20.0], hop=3), "depth": np.float32(5)}
    word = np.asarray(payload.pack(Message(np.int32(0), said), 4))
    made = arrays() | {"message": np.full((3, 4), word, np.uint32)}
    table = make_table("robots", made, scene()._replace(payload=payload_json(payload)))
    x, y, hop = (table[f"said_home_{part}"].to_pylist()[4:] for part in ("x", "y", "hop"))
    assert x == pytest.approx([0.0] * 8, abs=1e-8) and y == pytest.approx([0.02] * 8) and hop == [3] * 8
    assert table["said_depth"].to_pylist()[4:] == pytest.approx([5e-3] * 8)
    units = {part: table.schema.field(f"said_{part}").metadata[b"unit"] for part in ("home_y", "home_hop", "depth")}
    assert units == {"home_y": b"m", "home_hop": b"", "depth": b"m"}


def test_dead_robots_say_nothing_and_have_no_priority():
    payload, made = Payload({"priority": Flag(), "count": Integer(bits=4)}), arrays()
    made["is_alive"][:, 2] = False
    table = make_table("robots", made, scene()._replace(payload=payload_json(payload)))
    assert table["said_priority"].to_pylist() == [None] * 4 + [False] * 8
    assert table["said_count"].to_pylist() == [None] * 4 + [0, 0, None, 0] * 2


def test_a_metric_as_a_column_is_called():
    made = arrays() | {METRIC + "delivered": np.array([5, 6, 7])}
    about = {"names": ["delivered"], "units": ["1/s"], "descriptions": ["own"]}
    table = make_table("steps", made, scene()._replace(**{f"metric_{part}": each for part, each in about.items()}))
    assert table["metric_delivered"].to_pylist() == [5, 6, 7] and table["delivered"].to_pylist() == [0, 0, 0]
    assert table.schema.field("metric_delivered").metadata[b"unit"] == b"1/s"
