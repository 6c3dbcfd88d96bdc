"""Settings in files: fields that were added later do not keep a newer version from resuming."""

import pickle
from dataclasses import asdict, dataclass, field, replace

import pytest

from iswarm_mj.config import READINGS, OpticsConfig, StrategyConfig, SwarmConfig
from iswarm_mj.utils.serialization import added_later, completed, restored, to_dict


@dataclass(frozen=True)
class Inner:
    size: float = 2.0
    order: str = added_later("old")


@dataclass(frozen=True)
class Outer:
    inner: Inner = field(default_factory=Inner)
    count: int = 3
    mode: str = added_later("plain")


def test_later_fields_are_left_out_where_they_have_the_default():
    assert to_dict(Outer()) == {"inner": {"size": 2.0}, "count": 3}
    assert to_dict(Outer(Inner(order="new"), mode="rich")) == asdict(Outer(Inner(order="new"), mode="rich"))
    assert list(to_dict(Outer(mode="rich"))) == ["inner", "count", "mode"]


def test_fields_that_were_always_there_are_kept():
    assert to_dict(Outer(count=3)) == to_dict(Outer())
    assert to_dict(Outer(Inner(0.0), 0)) == {"inner": {"size": 0.0}, "count": 0}


LATER = {
    "strategy": {"update_order": "synchronous"},
    "optics": {
        "baud_rate": 0.0,
        "slots": 8,
        "photodiodes_while_emitting": "front",
        "serial_photodiodes": False,
        "capture_ratio": 0.0,
    },
}


def test_the_first_files_lack_what_was_added_later():
    usual = to_dict(SwarmConfig())
    for part, added in LATER.items():
        assert added.keys().isdisjoint(usual[part])
        assert added.items() <= asdict(SwarmConfig())[part].items()
    in_turn = to_dict(SwarmConfig(strategy=StrategyConfig(update_order="sequential")))
    assert in_turn["strategy"].pop("update_order") == "sequential" and in_turn == usual
    timed = to_dict(SwarmConfig(optics=OpticsConfig(baud_rate=1000.0)))
    assert timed["optics"].pop("baud_rate") == 1000.0 and timed == usual


def test_files_that_lack_a_reading_were_made_by_the_initial_one():
    said = to_dict(StrategyConfig())
    assert (said["avoidance_sides"], said["priority_repulsion"]) == ("front", "higher")
    assert {"avoidance_sides", "priority_repulsion"}.isdisjoint(to_dict(READINGS["initial"].strategy))


def test_what_a_file_lacks_is_as_it_was():
    """The dictionary of an earlier version, and of this one, becomes that of the settings again."""
    for config in READINGS.values():
        assert completed(SwarmConfig, to_dict(config)) == asdict(config)
    old = to_dict(READINGS["initial"])
    del old["strategy"]["random_turn"], old["drive"]
    assert completed(SwarmConfig, old)["strategy"].keys() == asdict(SwarmConfig())["strategy"].keys() - {"random_turn"}
    assert "drive" not in completed(SwarmConfig, old)


def test_a_later_default_is_kept_and_what_came_before_is_not():
    @dataclass(frozen=True)
    class Read:
        way: str = added_later("new", "old")

    assert to_dict(Read()) == {"way": "new"} and to_dict(Read("old")) == {}


def test_what_was_pickled_without_it_is_the_default():
    """As a process of an earlier version sends it to a newly started worker."""
    before = replace(StrategyConfig(), random_turn=20.0)
    del before.__dict__["update_order"]
    read = pickle.loads(pickle.dumps(before))
    assert "update_order" not in vars(read)
    assert read == StrategyConfig(random_turn=20.0) and hash(read) == hash(StrategyConfig(random_turn=20.0))


def test_configurations_come_back():
    config = SwarmConfig(optics=OpticsConfig(mode="power", baud_rate=5000.0))
    assert restored(SwarmConfig, to_dict(config)) == restored(SwarmConfig, asdict(config)) == config
    with pytest.raises(TypeError, match="colour"):
        restored(SwarmConfig, {"arena": {"colour": 1}})
