"""Files that are cut off, garbled, foreign, endless, or no files at all: each is read, or refused
in a sentence."""

import io
import json
import os
import re
import warnings
from dataclasses import replace
from functools import partial

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
from iswarm_mj.paper.report.inspection import inspection
from iswarm_mj.paper.report.results import report
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

GENOME = b'{"use_hop_count": true, "p_vector_forget": 0.29, "density_of_robots": 0.2, "fraction_scouts": 0.1}\n'
CONFIG = b'steps = 8\nrecord = false\nrecord_worlds = [0, 1]\nreading = "initial"\n[arena]\nsize = 55\nn_dust = 24\n'
STRATEGY = b"from iswarm_mj.strategy.base import Strategy\n\nclass Walk(Strategy):\n    init = picks = act = print\n"
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


def garbled(rng, content):
    """Bytes of a file after something went wrong with them."""
    at, to = np.sort(rng.integers(0, len(content) + 1, 2))
    flipped = bytearray(content)
    for place in rng.integers(len(flipped), size=rng.integers(1, 9)):
        flipped[place] ^= 1 << rng.integers(8)
    numbers = list(NUMBER.finditer(content)) or [re.match(b"", content)]
    number = pick(rng, numbers)
    made = [
        *(
            bytes(flipped),
            content[:at],
            content[:at] + content[to:],
            content[:at] + bytes(to - at) + content[to:],
        ),
        *(
            content[:to] + content[at:],
            pick(rng, FOREIGN),
            content[:at] + rng.bytes(rng.integers(50)) + content[at:],
        ),
        *(
            content + rng.bytes(rng.integers(5000)),
            content.decode("latin-1").encode(pick(rng, ["utf-16", "utf-8-sig"])),
        ),
        content[: number.start()] + pick(rng, ODD_NUMBERS) + content[number.end() :],
    ]
    return pick(rng, made)


def odd_json(rng, content):
    """JSON of which a value is another one, gone, of another name, or only brackets."""
    tree = place = json.loads(content)
    while True:
        key = pick(rng, list(place) if isinstance(place, dict) else range(len(place)))
        if not isinstance(place[key], dict | list) or not place[key] or rng.random() < 0.2:
            break
        place = place[key]
    match rng.integers(6):
        case 0 | 1 | 2:
            place[key] = pick(rng, ODD_VALUES)
        case 3:
            del place[key]
        case 4:
            place[key] = [place[key]]
        case 5:
            return pick(rng, [b"[" * 100_000, b'{"a":' * 100_000, b'{"a": 1, "a": 2}', b"9" * 5000])
    return json.dumps(tree).encode()


def odd_arrays(rng, content):
    """A file of arrays of which one is odd."""
    arrays = dict(np.load(io.BytesIO(content)))
    name = pick(rng, list(arrays))
    values = np.atleast_1d(arrays[name])
    spoilt = values.copy()
    if values.size and values.dtype.kind in "iuf":
        spoilt.reshape(-1)[rng.integers(values.size)] = np.array(
            pick(rng, [-1, 10**6, 1000])
        ).astype(values.dtype)
    kind = pick(rng, ["U3", "S2", "M8[s]", "c16", "f2"])
    odd = [
        values[:-1],
        values[None],
        np.zeros(values.shape, kind),
        np.full(values.shape, np.nan),
        np.zeros((0, 0)),
        spoilt,
    ]
    odd += [
        np.array([{"an": "object"}]),
        pick(rng, list(arrays.values())),
        values[..., :0],
        np.array("[" * 9999),
    ]
    arrays[name] = pick(rng, odd)
    if rng.random() < 0.1:
        del arrays[name]
    file = io.BytesIO()
    np.savez_compressed(file, **arrays)
    return file.getvalue()


def odd_table(rng, content):
    """A table of which a column or a setting is odd."""
    table = pq.read_table(io.BytesIO(content))
    at, n = int(rng.integers(table.num_columns)), len(table)
    name, metadata = table.column_names[at], dict(table.schema.metadata)
    column = pick(
        rng,
        [
            pa.nulls(n),
            pa.array(["x|<b>"] * n),
            pa.array([float("nan")] * n),
            pa.array([[1]] * n),
            None,
        ],
    )
    table = table.drop_columns([name]) if column is None else table.set_column(at, name, column)
    if rng.random() < 0.3:
        metadata[b"iswarm_mj"] = odd_json(rng, metadata[b"iswarm_mj"])
    file = io.BytesIO()
    pq.write_table(table.slice(0, pick(rng, [n, n, 0, 2])).replace_schema_metadata(metadata), file)
    return file.getvalue()


def no_file(rng, path):
    """Put something at the path that is no plain file of a fair size; return what."""
    kind = pick(rng, ["pipe", "folder", "loop", "endless", "gone", "forbidden", "sparse"])
    match kind:
        case "pipe":
            os.mkfifo(path)
        case "folder":
            path.mkdir()
        case "loop" | "endless":
            path.symlink_to(path.name if kind == "loop" else "/dev/zero")
        case "forbidden" | "sparse":
            path.touch(0 if kind == "forbidden" else 0o600)
            os.truncate(path, 2**40 if kind == "sparse" else 0)
    return kind


def attack_file(rng, path, read, odd=garbled):
    """Put something odd in the place of a good file, and read it; `read` may raise a UserError of
    one line."""
    good, luck = path.read_bytes(), rng.random()
    path.unlink()
    if luck < 0.08:
        event(no_file(rng, path))
    else:
        path.write_bytes(odd(rng, good) if luck < 0.5 else garbled(rng, good))
    try:
        with warnings.catch_warnings(), little_memory(2**31):
            warnings.simplefilter("ignore")
            read()
    except UserError as error:
        assert "\n" not in str(error) and len(str(error)) < 3000, error
        event("refused")
    finally:
        path.rmdir() if path.is_dir() and not path.is_symlink() else path.unlink(missing_ok=True)
        path.write_bytes(good)


def configured(path):
    """A command line that names the file."""
    return parse(["clean", "--config", str(path)])


@pytest.mark.parametrize("kind", ["genome", "robot", "strategy", "config", "weights"])
@attack(4)
def test_what_users_write(tmp_path, kind, seed):
    save_weights(tmp_path / "good.npz", np.arange(9.0))
    robot, weights = (
        (models_directory() / "robot6.xml").read_bytes(),
        (tmp_path / "good.npz").read_bytes(),
    )
    name, good, read, odd = {
        "genome": ("x.json", GENOME, lambda path: load_genome(str(path)), odd_json),
        "robot": ("x.xml", robot, read_robot, garbled),
        "strategy": ("x.py", STRATEGY, lambda path: find_strategy(f"{path}:Walk"), garbled),
        "config": ("x.toml", CONFIG, configured, garbled),
        "weights": ("x.npz", weights, load_weights, odd_arrays),
    }[kind]
    (tmp_path / name).write_bytes(good)
    read(tmp_path / name)
    attack_file(np.random.default_rng(seed), tmp_path / name, lambda: read(tmp_path / name), odd)


def read_everything(out):
    """A run by all that reads runs; refused if one of them refuses it."""
    refusals = []

    def tables():
        run = load(out)
        assert run.scene and all(map(len, (run.robots, run.balls, run.steps)))

    for read in (
        tables,
        lambda: load_recorded(out),
        lambda: inspection(out),
        lambda: configured(out / RESULT),
    ):
        try:
            read()
        except UserError as error:
            refusals.append(error)
    if refusals:
        raise refusals[0]


@pytest.mark.parametrize("name, alone", [(RESULT, False), (TRAJECTORY, False), (TRAJECTORY, True)])
@attack(6)
def test_runs(tmp_path, name, alone, seed):
    """Trajectories with and without a result.json, which says what they are."""
    out = write_run(tmp_path)
    if alone:
        (out / RESULT).unlink()
    read = (lambda: load(out).robots) if alone else (lambda: read_everything(out))
    attack_file(
        np.random.default_rng(seed), out / name, read, odd_json if name == RESULT else odd_arrays
    )


def same(jobs, *_):
    """Outcomes of jobs that are not computed."""
    yield from (
        (index, outcome_of(Measures(1, 1, 1, 2.0, None), 9, 0.5)) for index in range(len(jobs))
    )


@pytest.fixture
def unwritten(monkeypatch):
    """Searches and experiments without runs, tables and figures."""
    monkeypatch.setattr(pool, "run_jobs", same)
    for module in (search, experiment):
        monkeypatch.setattr(module, "write_table", lambda *_, **__: None)
    monkeypatch.setattr(search, "draw_fitness", lambda *_: None)


@pytest.mark.usefixtures("unwritten")
@pytest.mark.parametrize("kind", ["search", "experiment"])
@attack(3)
def test_journals(tmp_path, kind, seed):
    made = replace(EXPERIMENTS["hop-count"], judge=lambda _: [], figure=lambda *_: None)

    def read():
        if kind == "search":
            search.run_search(Search(generations=3, population=4), tmp_path)
        else:
            experiment.run_experiment(made, experiment.Plan(quick=True), tmp_path)

    read()
    path = tmp_path / (search.CHECKPOINT if kind == "search" else experiment.RUNS)
    attack_file(np.random.default_rng(seed), path, read)


@pytest.mark.parametrize(
    "name", ["grasp/trials.parquet", "hop-count/hop_count.parquet", "types/types.parquet"]
)
@attack(2)
def test_tables(tmp_path, name, seed):
    """A report names what cannot be used."""
    path = tmp_path / name
    path.parent.mkdir(exist_ok=True)
    path.write_bytes((models_directory().parent / "results/default" / name).read_bytes())
    read = partial(report, [tmp_path], tmp_path / "report.html")
    attack_file(np.random.default_rng(seed), path, read, odd_table)
