"""Tables of trajectories made by hand.

Strategies and tasks may name their columns like others.
"""

import numpy as np
import pytest
from support.recorded import arrays, scene
from support.sensing import remember

from iswarm_mj.output.message_columns import payload_json
from iswarm_mj.output.tables import make_table
from iswarm_mj.output.trajectory import METRIC
from iswarm_mj.sensors.fields import Flag, Integer, Real, Vector
from iswarm_mj.sensors.messages import Message, Payload

N_STEPS = 3
N_ROBOTS = 4
N_ROWS = N_STEPS * N_ROBOTS


def with_messages(payload, content):
    """Arrays of a trajectory in which all robots always send one message."""
    bits = np.asarray(payload.pack(Message(np.int32(0), content), 4))
    return arrays() | {"message": np.full((N_STEPS, N_ROBOTS), bits, np.uint32)}


def test_recorded_parts_named_like_columns_get_a_prefix():
    """`x` and `world` are columns, and `home` has a `home_0` before there is a part `home_0`."""
    values = np.arange(12.0).reshape(N_STEPS, N_ROBOTS)
    sizes = {"x": 1, "world": 1, "home": 2, "home_0": 1, "memory_x": 1}
    trajectory = arrays()
    for number, (name, size) in enumerate(sizes.items()):
        parts = [values + 100 * number + 50 * place for place in range(size)]
        trajectory[name] = parts[0] if size == 1 else np.stack(parts, axis=-1)
    world = scene()._replace(
        memory_names=list(sizes),
        memory_units=["", "", "m", "", ""],
        memory_sizes=list(sizes.values()),
        world=7,
    )

    table = make_table("robots", trajectory, world)

    assert len(set(table.column_names)) == len(table.column_names)
    np.testing.assert_array_equal(table["x"].to_numpy(), trajectory["pose"][..., 0].ravel())
    assert set(table["world"].to_pylist()) == {7}
    first_values = {
        "memory_x": 0,
        "memory_world": 100,
        "home_0": 200,
        "home_1": 250,
        "memory_home_0": 300,
        "memory_memory_x": 400,
    }
    for name, first in first_values.items():
        np.testing.assert_array_equal(table[name].to_numpy(), values.ravel() + first)


def test_a_strategy_may_record_and_send_under_one_name():
    """Robots sent 3 in each step and remember 9."""
    payload = Payload({"count": Integer(bits=4)})
    trajectory = with_messages(payload, {"count": np.int32(3)})
    trajectory["said_count"] = np.full((N_STEPS, N_ROBOTS), 9)
    world = scene()._replace(
        memory_names=["said_count"],
        memory_units=[""],
        memory_sizes=[1],
        payload=payload_json(payload),
    )
    table = make_table("robots", trajectory, world)
    assert table["said_count"].to_pylist() == [None] * N_ROBOTS + [3] * (N_ROWS - N_ROBOTS)
    assert table["memory_said_count"].to_pylist() == [9] * N_ROWS


class TestLengths:
    """Messages with a vector of 20 mm to the left (at most 62 mm) and a depth of 5 mm."""

    @pytest.fixture
    def table(self):
        payload = Payload({"home": Vector(62.0), "depth": Real(0, 7, bits=3, unit="mm")})
        content = {"home": remember([0.0, 20.0], hop=3), "depth": np.float32(5)}
        trajectory = with_messages(payload, content)
        return make_table("robots", trajectory, scene()._replace(payload=payload_json(payload)))

    def test_they_are_in_metres(self, table):
        def after_start(name):
            return table[f"said_{name}"].to_pylist()[N_ROBOTS:]

        assert after_start("home_x") == pytest.approx([0.0] * 8, abs=1e-8)
        assert after_start("home_y") == pytest.approx([0.02] * 8)
        assert after_start("home_hop") == [3] * 8
        assert after_start("depth") == pytest.approx([5e-3] * 8)

    @pytest.mark.parametrize(
        ("name", "unit"), [("home_y", b"m"), ("home_hop", b""), ("depth", b"m")]
    )
    def test_columns_state_the_unit(self, table, name, unit):
        assert table.schema.field(f"said_{name}").metadata[b"unit"] == unit


def test_dead_robots_send_nothing_and_have_no_priority():
    payload = Payload({"priority": Flag(), "count": Integer(bits=4)})
    trajectory = arrays()
    trajectory["is_alive"][:, 2] = False
    world = scene()._replace(payload=payload_json(payload))
    table = make_table("robots", trajectory, world)
    at_start = [None] * N_ROBOTS
    assert table["said_priority"].to_pylist() == at_start + [False] * 8
    assert table["said_count"].to_pylist() == at_start + [0, 0, None, 0] * 2


def test_a_metric_named_like_a_column_gets_a_prefix():
    trajectory = arrays() | {METRIC + "delivered": np.array([5, 6, 7])}
    world = scene()._replace(
        metric_names=["delivered"], metric_units=["1/s"], metric_descriptions=["own"]
    )
    table = make_table("steps", trajectory, world)
    assert table["metric_delivered"].to_pylist() == [5, 6, 7]
    assert table["delivered"].to_pylist() == [0, 0, 0]
    assert table.schema.field("metric_delivered").metadata[b"unit"] == b"1/s"
