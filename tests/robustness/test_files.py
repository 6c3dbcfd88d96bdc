"""Files that are cut off, garbled, foreign or endless: each is read, or refused in a sentence."""

import io
import json
import os
import re
import warnings
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import event
from support.attacks import ODD_VALUES, attack, pick
from support.files import little_memory
from support.recorded import write_run

from iswarm_mj import load
from iswarm_mj.commands.main import parse
from iswarm_mj.engines.robot_file import models_directory, read_robot
from iswarm_mj.output.offscreen import load_recorded
from iswarm_mj.output.trajectory import RESULT, TRAJECTORY
from iswarm_mj.paper.report.html_report import write_report
from iswarm_mj.paper.report.inspection import describe_directory
from iswarm_mj.paper.studies import experiment
from iswarm_mj.paper.studies.registry import EXPERIMENTS
from iswarm_mj.search import pool, search
from iswarm_mj.search.pool import outcome_of
from iswarm_mj.search.search import Search
from iswarm_mj.strategy.genome import load_genome
from iswarm_mj.strategy.library import find_strategy
from iswarm_mj.strategy.network import load_weights, save_weights
from iswarm_mj.tasks.measures import Measures
from iswarm_mj.utils.errors import UserError

GENOME = (
    b'{"use_hop_count": true, "p_vector_forget": 0.29, "density_of_robots": 0.2, '
    b'"fraction_scouts": 0.1}\n'
)
CONFIG = (
    b'steps = 8\nrecord = false\nrecord_worlds = [0, 1]\nreading = "initial"\n'
    b"[arena]\nsize = 55\nn_dust = 24\n"
)
STRATEGY = (
    b"from iswarm_mj.strategy.base import Strategy\n\n"
    b"class Walk(Strategy):\n    init = picks = act = print\n"
)
FOREIGN = [
    GENOME,
    STRATEGY,
    b"PAR1" * 9,
    b"PK\3\4" + bytes(60),
    b"\x89PNG\r\n",
    b"<mujoco/>",
    b"[]",
    b"{}",
    b"",
]
"""Contents of files of another kind."""
NUMBER = re.compile(rb"(?<![\w.])-?\d+(?:\.\d+)?(?:e-?\d+)?")
ODD_NUMBERS = [
    b"nan",
    b"inf",
    b"-1",
    b"0",
    b"1e308",
    b"1e-320",
    b"-0.0",
    b"9" * 400,
    b"x",
    b"1 2",
    b"0x7f",
]
ODD_JSON = [b"[" * 100_000, b'{"a":' * 100_000, b'{"a": 1, "a": 2}', b"9" * 5000]
"""Texts that JSON readers may fail at."""
ODD_TYPES = ["U3", "S2", "M8[s]", "c16", "f2"]
"""Types of arrays that no file has."""
SHARE_OF_NO_FILES = 0.08
"""Share of cases in which no plain file is in the place of the good one."""
MEMORY_BYTES = 2**31
"""Memory that reading a file may take."""

# What may happen to the content of a file.


def garbled(rng, content):
    """Return the bytes of a file after something went wrong with them."""
    start, end = np.sort(rng.integers(0, len(content) + 1, 2))
    numbers = list(NUMBER.finditer(content)) or [re.match(b"", content)]
    number = pick(rng, numbers)
    variants = [
        with_flipped_bits(rng, content),
        content[:start],  # cut off
        content[:start] + content[end:],  # with a gap
        content[:start] + bytes(end - start) + content[end:],  # with zeros
        content[:end] + content[start:],  # with a part twice
        pick(rng, FOREIGN),
        content[:start] + rng.bytes(rng.integers(50)) + content[end:],
        content + rng.bytes(rng.integers(5000)),
        content.decode("latin-1").encode(pick(rng, ["utf-16", "utf-8-sig"])),
        content[: number.start()] + pick(rng, ODD_NUMBERS) + content[number.end() :],
    ]
    return pick(rng, variants)


def with_flipped_bits(rng, content):
    """Return bytes of which some have another bit."""
    flipped = bytearray(content)
    for place in rng.integers(len(flipped), size=rng.integers(1, 9)):
        flipped[place] ^= 1 << rng.integers(8)
    return bytes(flipped)


def odd_json(rng, content):
    """Return JSON of which a value is another one, gone, or within a list; or only brackets."""
    tree = json.loads(content)
    place, key = drawn_place(rng, tree)
    match rng.integers(6):
        case 0 | 1 | 2:
            place[key] = pick(rng, ODD_VALUES)
        case 3:
            del place[key]
        case 4:
            place[key] = [place[key]]
        case 5:
            return pick(rng, ODD_JSON)
    return json.dumps(tree).encode()


def drawn_place(rng, tree):
    """Return a map or list within a tree of JSON, and a key of it."""
    place = tree
    while True:
        keys = list(place) if isinstance(place, dict) else range(len(place))
        key = pick(rng, keys)
        child = place[key]
        if not isinstance(child, dict | list) or not child or rng.random() < 0.2:
            return place, key
        place = child


def odd_arrays(rng, content):
    """Return a file of arrays of which one is odd, and perhaps gone."""
    arrays = dict(np.load(io.BytesIO(content)))
    name = pick(rng, list(arrays))
    arrays[name] = odd_array(rng, np.atleast_1d(arrays[name]), list(arrays.values()))
    if rng.random() < 0.1:
        del arrays[name]
    file = io.BytesIO()
    np.savez_compressed(file, **arrays)
    return file.getvalue()


def odd_array(rng, values, all_arrays):
    """Return an array in the place of some values.

    Args:
        rng: source of all that is random.
        values: present values.
        all_arrays: arrays of the same file.
    """
    variants = [
        values[:-1],
        values[None],
        values[..., :0],
        np.zeros(values.shape, pick(rng, ODD_TYPES)),
        np.full(values.shape, np.nan),
        np.zeros((0, 0)),
        with_odd_number(rng, values),
        np.array([{"an": "object"}]),
        np.array("[" * 9999),
        pick(rng, all_arrays),
    ]
    return pick(rng, variants)


def with_odd_number(rng, values):
    """Return a copy of an array with another number in one place."""
    changed = values.copy()
    if values.size and values.dtype.kind in "iuf":
        number = np.array(pick(rng, [-1, 10**6, 1000]))
        changed.reshape(-1)[rng.integers(values.size)] = number.astype(values.dtype)
    return changed


def odd_table(rng, content):
    """Return a table of which a column or a setting is odd."""
    table = pq.read_table(io.BytesIO(content))
    table = with_odd_column(rng, table)
    metadata = dict(table.schema.metadata)
    if rng.random() < 0.3:
        metadata[b"iswarm_mj"] = odd_json(rng, metadata[b"iswarm_mj"])
    n_rows = pick(rng, [len(table), len(table), 0, 2])
    file = io.BytesIO()
    pq.write_table(table.slice(0, n_rows).replace_schema_metadata(metadata), file)
    return file.getvalue()


def with_odd_column(rng, table):
    """Return a table without one of its columns, or with another one in its place."""
    index = int(rng.integers(table.num_columns))
    name = table.column_names[index]
    n_rows = len(table)
    columns = [
        pa.nulls(n_rows),
        pa.array(["x|<b>"] * n_rows),
        pa.array([float("nan")] * n_rows),
        pa.array([[1]] * n_rows),
        None,
    ]
    column = pick(rng, columns)
    if column is None:
        return table.drop_columns([name])
    return table.set_column(index, name, column)


# What may be in the place of a file.


def put_no_file(rng, path):
    """Put something at a path that is no plain file of a fair size; return its kind."""
    kinds = ["pipe", "folder", "loop", "endless", "gone", "forbidden", "sparse"]
    if not hasattr(os, "mkfifo"):  # on Windows
        kinds.remove("pipe")
    kind = pick(rng, kinds)
    match kind:
        case "pipe":
            os.mkfifo(path)
        case "folder":
            path.mkdir()
        case "loop":
            path.symlink_to(path.name)
        case "endless":
            path.symlink_to("/dev/zero")
        case "forbidden":
            path.touch(0)
        case "sparse":
            path.touch(0o600)
            os.truncate(path, 2**40)
    return kind


def remove(path):
    """Remove whatever is at a path."""
    if path.is_dir() and not path.is_symlink():
        path.rmdir()
    else:
        path.unlink(missing_ok=True)


def attack_file(rng, path, read, odd=garbled):
    """Put something odd in the place of a good file, read it, and put the good file back.

    Args:
        rng: source of all that is random.
        path: good file.
        read: reads it; may raise a UserError of one line.
        odd: function of `rng` and the content that returns an odd content.
    """
    good = path.read_bytes()
    luck = rng.random()
    path.unlink()
    if luck < SHARE_OF_NO_FILES:
        event(put_no_file(rng, path))
    elif luck < 0.5:
        path.write_bytes(odd(rng, good))
    else:
        path.write_bytes(garbled(rng, good))
    try:
        with warnings.catch_warnings(), little_memory(MEMORY_BYTES):
            warnings.simplefilter("ignore")
            read()
    except UserError as error:
        assert "\n" not in str(error)
        assert len(str(error)) < 3000
        event("refused")
    finally:
        remove(path)
        path.write_bytes(good)


# Files that users write.


class Kind(NamedTuple):
    """A kind of file that users write."""

    name: str
    """Name of the file."""
    write: Callable[[Path], Any]
    """Writes a good file."""
    read: Callable[[Path], Any]
    """Reads the file."""
    odd: Callable[[np.random.Generator, bytes], bytes] = garbled
    """Returns an odd content."""


def writer(content):
    """Return a function that writes a content to a path."""
    return lambda path: path.write_bytes(content)


def read_config(path):
    """Read a command line that names a file of settings."""
    return parse(["clean", "--config", str(path)])


ROBOT = (models_directory() / "robot6.xml").read_bytes()
KINDS = {
    "genome": Kind("x.json", writer(GENOME), lambda path: load_genome(str(path)), odd_json),
    "robot": Kind("x.xml", writer(ROBOT), read_robot),
    "strategy": Kind("x.py", writer(STRATEGY), lambda path: find_strategy(f"{path}:Walk")),
    "config": Kind("x.toml", writer(CONFIG), read_config),
    "weights": Kind(
        "x.npz", lambda path: save_weights(path, np.arange(9.0)), load_weights, odd_arrays
    ),
}


@pytest.mark.parametrize("kind", KINDS.values(), ids=KINDS)
@attack(4)
def test_what_users_write(tmp_path, kind, seed):
    path = tmp_path / kind.name
    kind.write(path)
    kind.read(path)
    attack_file(np.random.default_rng(seed), path, lambda: kind.read(path), kind.odd)


# Files of runs.


def read_tables(out):
    """Read the tables of a run, which have rows."""
    run = load(out)
    assert run.scene
    assert len(run.robots)
    assert len(run.balls)
    assert len(run.steps)


def read_everything(out):
    """Read a run by all that reads runs.

    Raises:
        UserError: one of them refuses it.
    """
    refusals = []
    for read in (
        partial(read_tables, out),
        partial(load_recorded, out),
        partial(describe_directory, out),
        partial(read_config, out / RESULT),
    ):
        try:
            read()
        except UserError as error:
            refusals.append(error)
    if refusals:
        raise refusals[0]


@pytest.mark.parametrize("name", [RESULT, TRAJECTORY])
@attack(6)
def test_runs(tmp_path, name, seed):
    out = write_run(tmp_path)
    odd = odd_json if name == RESULT else odd_arrays
    attack_file(np.random.default_rng(seed), out / name, lambda: read_everything(out), odd)


@attack(6)
def test_trajectories_without_a_result(tmp_path, seed):
    """There is no result.json, which says what they are."""
    out = write_run(tmp_path)
    (out / RESULT).unlink()
    path = out / TRAJECTORY
    attack_file(np.random.default_rng(seed), path, lambda: load(out).robots, odd_arrays)


# Files of searches and experiments.


def same_outcomes(jobs, *_):
    """Yield the same outcome for each job, which is not computed."""
    for index in range(len(jobs)):
        yield index, outcome_of(Measures(1, 1, 1, 2.0, None), 9, 0.5)


@pytest.fixture
def without_runs(monkeypatch):
    """Searches and experiments without runs, tables and figures."""
    monkeypatch.setattr(pool, "run_jobs", same_outcomes)
    for module in (search, experiment):
        monkeypatch.setattr(module, "write_table", lambda *_, **__: None)
    monkeypatch.setattr(search, "draw_fitness", lambda *_: None)


@pytest.mark.usefixtures("without_runs")
@attack(3)
def test_the_journal_of_a_search(tmp_path, seed):
    def read():
        search.run_search(Search(generations=3, population=4), tmp_path)

    read()
    attack_file(np.random.default_rng(seed), tmp_path / search.CHECKPOINT, read)


@pytest.mark.usefixtures("without_runs")
@attack(3)
def test_the_journal_of_an_experiment(tmp_path, seed):
    hop_count = replace(EXPERIMENTS["hop-count"], judge=lambda _: [], figure=lambda *_: None)

    def read():
        experiment.run_experiment(hop_count, experiment.Plan(quick=True), tmp_path)

    read()
    attack_file(np.random.default_rng(seed), tmp_path / experiment.RUNS, read)


@pytest.mark.parametrize(
    "name", ["grasp/trials.parquet", "hop-count/hop_count.parquet", "types/types.parquet"]
)
@attack(2)
def test_tables(tmp_path, name, seed):
    """A report names what cannot be used."""
    path = tmp_path / name
    path.parent.mkdir(exist_ok=True)
    path.write_bytes((models_directory().parent / "results/default" / name).read_bytes())
    read = partial(write_report, [tmp_path], tmp_path / "report.html")
    attack_file(np.random.default_rng(seed), path, read, odd_table)
