"""A strategy with messages of its own in a file outside the package: every engine carries them; its mistakes."""

import re
from pathlib import Path

import numpy as np
import pytest
from helpers_cli import code_of
from helpers_rrd import read

import iswarm_mj

GOSSIP = """
import jax
import jax.numpy as jnp

from iswarm_mj.sensors.fields import Bearing, Flag, Integer, Real, Vector
from iswarm_mj.strategy.interface import Command

class Gossip:
    payload = {"count": Integer(bits=4), "heat": Real(0, 1, bits=8), "aim": Bearing(bits=3)}
    recorded = ("count", "heat")

    def init(self, n_robots, key):
        heat = jnp.arange(n_robots) / n_robots
        return {"count": jnp.arange(n_robots), "heat": heat, "aim": heat - 0.5}
    def say(self, memory, is_loaded):
        return memory
    def picks(self, memory):
        return memory["count"] >= 0
    def act(self, memory, seen, key):
        def largest(name):
            return jnp.where(seen.is_heard, seen.payload[name], memory[name][:, None]).max(axis=1)
        count = jnp.maximum(memory["count"], largest("count"))
        turn = jax.random.uniform(key, count.shape, minval=-1)
        return {"count": count, "heat": largest("heat"), "aim": turn}, Command(turn, jnp.full_like(turn, 1.0))
"""
"""At most 25 lines of code."""
FEW = ("--arena.size=10", "--arena.dump-size=3", "--arena.dust-area-size=2", "--arena.dust-area-offset=3.5")
FEW += ("--arena.n-dust=5", "--robots=12", "--steps=6")


@pytest.fixture(autouse=True)
def gossip(here):
    (here / "gossip.py").write_text(GOSSIP)


def gossiping(*arguments):
    """Exit code of a run of it."""
    return code_of("clean", "--strategy", "gossip.py:Gossip", *FEW, *arguments)


@pytest.mark.parametrize("engine", ["mujoco", "planar", pytest.param("mjx", marks=pytest.mark.slow)])
def test_every_engine_carries_its_messages(engine):
    quiet = [f"--optics.{name}=0" for name in ("error-in-communication", "p-communication-break")]
    assert gossiping("--engine", engine, *quiet) == 0
    run = iswarm_mj.load("runs/clean")
    shape = (7, 12)
    table = {name: run.robots[name].to_numpy(zero_copy_only=False).reshape(shape) for name in run.robots.column_names}
    assert "said_dust_x" not in table and "said_priority" not in table
    for name, step, most in (("count", 1, 15), ("heat", 1 / 255, 1), ("aim", 2 * np.pi / 8, 4)):
        said = table[f"said_{name}"]
        assert np.isnan(said[0].astype(float)).all() and np.abs(said[1:]).max() <= most
        if name != "aim":  # a robot says what it remembered
            np.testing.assert_allclose(said[1:], np.clip(table[name][:-1], 0, most), atol=step / 2 + 1e-6)
        np.testing.assert_allclose(said[1:] / step, np.round(said[1:].astype(float) / step), atol=1e-3)
    assert run.units["robots"]["said_aim"] == "rad" and run.units["robots"]["said_heat"] == ""
    links = run.links.to_pydict()
    assert all(links["is_heard"]) and len(links["step"]) > 20
    for step, receiver, sender in zip(links["step"], links["receiver"], links["sender"], strict=True):
        assert table["count"][step, receiver] >= table["said_count"][step, sender]
    assert (table["count"][-1] > np.arange(12)).any()
    body = read("runs/clean/clean.rrd")["/world/robots/body"]
    np.testing.assert_array_equal(np.array(body["said_count"])[1:], table["said_count"][1:])


def test_in_turn_news_goes_further_within_a_step():
    """With a method `listen`, which sequential updates need."""
    listen = "    def listen(self, memory, seen, key):\n        return self.act(memory, seen, key)[0]\n"
    Path("gossip.py").write_text(GOSSIP + listen)
    known = []
    for order in ("synchronous", "sequential"):
        assert (
            code_of(
                "clean",
                "--strategy",
                "gossip.py:Gossip",
                *FEW[:-2],
                "--steps=6",
                "--engine=planar",
                "--robots=25",
                "--seed=1",
                f"--strategy.update-order={order}",
            )
            == 0
        )
        known.append(iswarm_mj.load("runs/clean").robots["count"].to_numpy().reshape(7, 25)[2].sum())
    assert known[1] > known[0]


@pytest.mark.parametrize(
    "old, new, words",
    [
        ("Integer(bits=4)", "Integer(bits=21)", "payload of 32 bits .* leave out or shorten fields by 3 bits"),
        ('"count": Integer', '"led": Integer', "cannot be called 'led'"),
        ('{"count": Integer(bits=4), "heat"', '{"heat"', "dictionary with the payload's fields heat, aim .got "),
        (
            "        return memory\n",
            "        return memory | {'heat': memory['count']}\n",
            "float32.12. as its field heat",
        ),
        (
            "    payload = ",
            "    payloads = ",
            "Gossip has a method say, but no attribute payload; declare what it says",
        ),
    ],
)
def test_mistakes(capfd, old, new, words):
    assert old in GOSSIP
    Path("gossip.py").write_text(GOSSIP.replace(old, new))
    assert gossiping("--engine=planar") == 2
    _, error = capfd.readouterr()
    assert re.search(words, " ".join(error.split())), error
    assert "Traceback" not in error
