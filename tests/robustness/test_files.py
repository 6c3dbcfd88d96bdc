"""Files that are cut off, garbled, foreign, endless, or no files at all: each is read, or refused in a sentence."""

import io
import shutil
import warnings

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from helpers_broken_files import garbled, odd_arrays, odd_json, remove, replace_by_no_file
from helpers_command_lines import WALK
from helpers_files import little_memory

from iswarm_mj import load
from iswarm_mj.engines.arena import read_robot
from iswarm_mj.engines.robot_file import models_directory
from iswarm_mj.experiments.report.writer import report
from iswarm_mj.experiments.runner import experiment, pool, search
from iswarm_mj.experiments.runner.jobs import Outcome
from iswarm_mj.experiments.runner.search_settings import Search
from iswarm_mj.experiments.studies.registry import EXPERIMENTS
from iswarm_mj.output.stage import recorded
from iswarm_mj.output.trajectory import RESULT, TRAJECTORY
from iswarm_mj.strategy.genome import load_genome
from iswarm_mj.strategy.library import find_strategy
from iswarm_mj.strategy.pytrees import check_methods
from iswarm_mj.tasks.measures import Measures
from iswarm_mj.utils.errors import UserError

GENOME = b'{"use_hop_count": true, "p_vector_forget": 0.29, "density_of_robots": 0.2, "fraction_scouts": 0.1}\n'


def attack_file(attack, path, good, read, odd=None):
    """Put odd files where a good one belongs, and read them.

    Args:
        attack: that draws the cases.
        path: of the file.
        good: its content, which can be read.
        read: reads it; may raise a UserError of one line.
        odd: makes content of the right format that says something else.
    """
    path.write_bytes(good)
    read()
    others = [
        good,
        GENOME,
        WALK.encode(),
        b"PAR1" * 9,
        b"PK\3\4" + bytes(60),
        b"\x89PNG\r\n",
        b"<mujoco/>",
        b"[]",
        b"{}",
    ]
    for rng in attack.generators():
        kind, luck = "garbled", rng.random()
        if luck < 0.08:
            kind = replace_by_no_file(rng, path)
        elif luck < 0.5 and odd is not None:
            kind = "odd"
            path.write_bytes(odd(rng, good))
        else:
            path.write_bytes(garbled(rng, good, others))
        with attack.case(kind, 60) as outcome, warnings.catch_warnings(), little_memory(2**31):
            warnings.simplefilter("ignore")
            try:
                read()
                outcome.append("read")
            except UserError as error:
                assert "\n" not in str(error) and len(str(error)) < 3000, error
                outcome.append("refused")
        remove(path)


@pytest.mark.attack(12)
def test_genomes(attack, tmp_path):
    path = tmp_path / "genome.json"
    attack_file(attack, path, GENOME, lambda: load_genome(str(path)), odd_json)


@pytest.mark.attack(15)
@pytest.mark.parametrize("name", ["robot.xml", "robot6.xml"])
def test_robots(attack, tmp_path, name):
    path = tmp_path / name
    attack_file(attack, path, (models_directory() / name).read_bytes(), lambda: read_robot(path))


@pytest.mark.attack(12)
def test_strategies(attack, tmp_path):
    path = tmp_path / "walk.py"
    attack_file(attack, path, WALK.encode(), lambda: check_methods(find_strategy(f"{path}:Walk")))


def read_everything(out):
    """A run by all that reads runs; refused if one of them refuses it."""
    refusals = []
    for read in (tables_of, recorded):
        try:
            read(out)
        except UserError as error:
            refusals.append(error)
    if refusals:
        raise refusals[0]


def tables_of(out):
    run = load(out)
    for table in (run.robots, run.balls, run.links, run.steps):
        assert len(table)
    assert run.units and run.scene


@pytest.mark.attack(12)
@pytest.mark.parametrize(("name", "odd"), [(RESULT, odd_json), (TRAJECTORY, odd_arrays)])
def test_runs(attack, recorded_run, tmp_path, name, odd):
    out = shutil.copytree(recorded_run, tmp_path / "run")
    attack_file(attack, out / name, (out / name).read_bytes(), lambda: read_everything(out), odd)


def same(jobs, *_):
    """Outcomes of jobs that are not computed."""
    yield from ((index, Outcome(Measures(1, 1, 1, 2.0, None), 9, 0.5)) for index in range(len(jobs)))


@pytest.mark.attack(12)
@pytest.mark.parametrize("kind", ["search", "experiment"])
def test_journals(attack, tmp_path, monkeypatch, kind, capsys):
    """Of a search, and of an experiment."""
    monkeypatch.setattr(pool, "run_jobs", same)
    for module in (search, experiment):
        monkeypatch.setattr(module, "write_table", lambda *_, **__: None)
    monkeypatch.setattr(search, "draw_fitness", lambda *_: None)
    found, plan = Search(generations=3, population=4), experiment.Plan(quick=True)
    made = experiment.Experiment("x", "", "", EXPERIMENTS["hop-count"].entries, lambda _: [], lambda *_: [])

    def read():
        if kind == "search":
            search.run_search(found, tmp_path, resume=True)
        else:
            experiment.run_experiment(made, plan, tmp_path)
        capsys.readouterr()

    read()
    path = tmp_path / (search.CHECKPOINT if kind == "search" else experiment.RUNS)
    attack_file(attack, path, path.read_bytes(), read)


TABLES = ["grasp/trials.parquet", "hop-count/hop_count.parquet", "message-time/message_time.parquet"]


@pytest.mark.attack(12)
@pytest.mark.parametrize("name", TABLES)
def test_tables(attack, tmp_path, name, capsys):
    """What cannot be used is left out of a report, and named."""
    good = (models_directory().parent / "results" / name).read_bytes()
    path = tmp_path / name
    path.parent.mkdir()

    def read():
        report([tmp_path], tmp_path / "report.html")
        if path.name in str(capsys.readouterr().out):
            raise UserError("left out")

    attack_file(attack, path, good, read, odd_table)


def odd_table(rng, content):
    """A table of which a column or a setting is odd."""
    table = pq.read_table(io.BytesIO(content))
    at = int(rng.integers(table.num_columns))
    name = table.column_names[at]
    metadata = dict(table.schema.metadata)
    match rng.integers(7):
        case 0:
            table = table.drop_columns([name])
        case 1:
            table = table.set_column(at, name, pa.nulls(len(table)))
        case 2:
            table = table.set_column(at, name, pa.array(["x|<b>"] * len(table)))
        case 3:
            table = table.set_column(at, name, pa.array([float("nan")] * len(table)))
        case 4:
            table = table.slice(0, int(rng.integers(0, 3)))
        case 5:
            table = table.set_column(at, name, pa.array([[1]] * len(table)))
        case 6:
            metadata[b"iswarm_mj"] = odd_json(rng, metadata[b"iswarm_mj"])
    file = io.BytesIO()
    pq.write_table(table.replace_schema_metadata(metadata), file)
    return file.getvalue()
