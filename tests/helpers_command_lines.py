"""Command lines drawn from the parsers of all commands, so that new flags are among them."""

import functools
import warnings
from dataclasses import dataclass

import tyro

from iswarm_mj.commands.config_options import with_reading
from iswarm_mj.commands.flags import _values
from iswarm_mj.commands.main import COMMANDS

NUMBERS = [
    "0", "1", "-1", "2", "3", "5", "7", "10", "48", "49", "100", "1000", "0.0", "0.1", "0.5", "0.999", "1.0", "1.5",
    "30", "45", "60", "89.9", "90", "180", "360", "1e-9", "1e-6", "1e-320", "1e300", "-0.0", "nan", "inf", "-inf",
    "1e999", "4294967294", "4294967295", "4294967296", "9223372036854775808", "-9223372036854775809", "1_000", "0x10",
    "١٢", "+3", "3.", ".5", "1e-3", "5e-324", "12345678901234567890", "00012", "1,5", "1/2", "9" * 400, "9" * 5000,
]  # fmt: skip
TEXTS = [
    "", " ", "\n", "a\nb", "ä", "🤖", "\udcff", "None", "none", "True", "false", "--", "-", "-h", "=", "a" * 300,
    "a" * 5000, "../..", "/dev/null", "/dev/full", "/proc/self/nothing", "%s%n", "{}", "'", '"', "$HOME", "*", "[1,2]",
    "NaN", "all",
]  # fmt: skip
PATHS = [
    "runs/clean", "runs/none", "genome.json", "odd.json", "walk.py", "walk.py:Walk", "walk.py:", ":Walk",
    "walk.py:None", "robot6.xml", "odd.xml", "results", "empty", "new/deep", "a.html", "a.mp4", "a.png", "loop",
    "genome.json/below", "type1", "type2", "evolved", "density", "types", "hop-count", "robustness", "sensitivity",
    "time-step", "message-time", "resolved-grasps", "evolve-paper", "grasp",
]  # fmt: skip
WALK = """
from dataclasses import dataclass
import jax.numpy as jnp
from iswarm_mj.strategy.interface import Command

@dataclass
class Walk:
    speed: float = 1.0

    def init(self, n_robots, key):
        return jnp.zeros(n_robots)

    def picks(self, memory):
        return memory < jnp.inf

    def act(self, memory, seen, key):
        return memory + self.speed, Command(memory, jnp.full_like(memory, self.speed))
"""
"""A file with a strategy."""


@dataclass(frozen=True)
class Flag:
    """A flag of a command, or a value without one."""

    names: tuple[str, ...]
    """Such as --record and --no-record; none for a value by its place."""
    takes: str
    """`no` value, `one`, or `many`."""
    kind: str
    """What the parser says of the value, such as INT."""
    choices: tuple[str, ...]
    default: str


@functools.cache
def flags_of(name):
    """All flags of a command, as its parser has them."""
    command = COMMANDS[name]
    usual = command()
    defaults = {"--" + key.replace("_", "-"): value for key, value in _values(usual)}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        parser = tyro.extras.get_parser(command, default=with_reading(command, []))
    found = []
    for action in parser._actions:
        names = tuple(option for option in action.option_strings if option.startswith("--"))
        takes = {0: "no", 1: "one", None: "one", "?": "one"}.get(action.nargs, "many")
        default = defaults.get(names[0]) if names else None
        default = " ".join(map(str, default)) if isinstance(default, tuple) else str(default)
        found.append(Flag(names, takes, str(action.metavar), tuple(map(str, action.choices or ())), default))
    return tuple(found)


def command_line(rng, name=None):
    """Arguments of a command; of some the command itself is odd."""
    names = list(COMMANDS)
    name = name or names[rng.integers(len(names))]
    if rng.random() < 0.01:
        return [_pick(rng, [*TEXTS, name[:-1], name.upper(), "--version", "--help"]), "--seed=1"]
    known, line = flags_of(name), [name]
    for _ in range(rng.integers(0, 7)):
        line += _given(rng, known[rng.integers(len(known))])
    if rng.random() < 0.05:
        line.insert(rng.integers(1, len(line) + 1), _pick(rng, TEXTS + PATHS + NUMBERS))
    return line


def _given(rng, flag):
    """A flag with its value, or as nobody should give it."""
    if not flag.names:
        return [_value(rng, flag)]
    name = flag.names[rng.integers(len(flag.names))]
    if name == "--help" and rng.random() < 0.8:
        return []
    odd = rng.random()
    if odd < 0.02:
        name = name[: rng.integers(2, len(name) + 1)]  # may be another one's beginning
    elif odd < 0.04:
        name = name.replace("-", "_") if odd < 0.03 else name.replace(".", "-")
    if flag.takes == "no":
        return [name] if rng.random() < 0.97 else [f"{name}={_value(rng, flag)}"]
    values = [_value(rng, flag) for _ in range(rng.integers(0, 4))] if flag.takes == "many" else [_value(rng, flag)]
    if rng.random() < 0.02:
        values = values[1:]
    if len(values) == 1 and rng.random() < 0.5:
        return [f"{name}={values[0]}"]
    return [name, *values]


def _value(rng, flag):
    """A value that the flag may take, or one that it may not."""
    luck = rng.random()
    if flag.choices and luck < 0.9:
        return _pick(rng, flag.choices)
    if luck < 0.5 and flag.default not in ("", "None"):
        return _near(rng, flag.default.split()[0])
    if "PATH" in flag.kind or "STR" in flag.kind or "FILE" in flag.kind:
        return _pick(rng, PATHS + TEXTS if luck < 0.9 else NUMBERS)
    return _pick(rng, NUMBERS if luck < 0.95 else TEXTS + PATHS)


def _near(rng, default):
    """A default, or a number of its size."""
    try:
        number = float(default)
    except ValueError:
        return default
    scaled = number * _pick(rng, [1, 0.5, 2, 0.9, 1.1, 10, 0.1, -1])
    return str(round(scaled)) if "." not in default and "e" not in default else f"{scaled:.6g}"


def _pick(rng, values):
    return values[rng.integers(len(values))]
