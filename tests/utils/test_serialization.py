"""Settings as files keep them: later fields do not part a file from the program that goes on with it."""

import pickle
from dataclasses import asdict, dataclass, field, replace

from iswarm_mj.config import StrategyConfig, SwarmConfig
from iswarm_mj.utils.serialization import kept, later


@dataclass(frozen=True)
class Inner:
    size: float = 2.0
    order: str = later("old")


@dataclass(frozen=True)
class Outer:
    inner: Inner = field(default_factory=Inner)
    count: int = 3
    mode: str = later("plain")


def test_later_fields_are_left_out_where_they_have_the_default():
    assert kept(Outer()) == {"inner": {"size": 2.0}, "count": 3}
    assert kept(Outer(Inner(order="new"), mode="rich")) == asdict(Outer(Inner(order="new"), mode="rich"))
    assert list(kept(Outer(mode="rich"))) == ["inner", "count", "mode"]


def test_fields_that_were_always_there_are_kept():
    assert kept(Outer(count=3)) == kept(Outer()) and kept(Outer(Inner(0.0), 0)) == {"inner": {"size": 0.0}, "count": 0}


def test_the_update_order_is_later_than_the_first_files():
    usual = asdict(SwarmConfig())
    assert usual["strategy"].pop("update_order") == "synchronous"
    assert kept(SwarmConfig()) == usual
    in_turn = SwarmConfig(strategy=StrategyConfig(update_order="sequential"))
    assert kept(in_turn) == asdict(in_turn)


def test_what_was_pickled_without_it_is_the_default():
    """As a worker gets it that is started anew by a process of the program before."""
    before = replace(StrategyConfig(), random_turn=20.0)
    del before.__dict__["update_order"]
    read = pickle.loads(pickle.dumps(before))
    assert "update_order" not in vars(read)
    assert read == StrategyConfig(random_turn=20.0) and hash(read) == hash(StrategyConfig(random_turn=20.0))
