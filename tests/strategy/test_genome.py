"""Genomes: the values of Table 2, and files of genomes."""

import json
from dataclasses import astuple, fields, replace
from pathlib import Path

import pytest

from iswarm_mj.strategy.genome import PRESETS, Genome, load_genome
from iswarm_mj.utils.errors import UserError

TABLE_2 = {
    "density_of_robots": (0.118, 0.132),
    "fraction_scouts": (0.08, 0.27),
    "p_vector_forget": (0.29, 0.14),
    "use_hop_count": (True, True),
    "priority_coll_avoid_dist": (0.40, 0.41),
    "empty_coll_avoid_dist": (0.65, 0.77),
    "loaded_coll_avoid_dist": (0.25, 0.27),
    "priority_signal_scouts": (False, False),
    "priority_signal_loaded": (True, True),
    "weight_find_dust": (0.83, 0.82),
    "weight_find_dump": (0.94, 1.00),
}


@pytest.fixture
def write(tmp_path):
    """Function that writes text, or an object as JSON, and returns the path."""

    def write(text):
        path = tmp_path / "genome.json"
        path.write_text(text if isinstance(text, str) else json.dumps(text))
        return str(path)

    return write


@pytest.mark.parametrize("column, name", [(0, "type1"), (1, "type2")])
def test_presets_are_table_2(column, name):
    assert [f.name for f in fields(Genome)] == list(TABLE_2)
    assert astuple(load_genome(name)) == tuple(row[column] for row in TABLE_2.values())


def test_a_file_may_hold_all_or_some(write):
    assert load_genome(write({name: row[1] for name, row in TABLE_2.items()})) == PRESETS["type2"]
    some = load_genome(write({"p_vector_forget": 0, "use_hop_count": False}))
    assert some == replace(PRESETS["type1"], p_vector_forget=0, use_hop_count=False)

    result = {"steps": 9, "genome": {"p_vector_forget": 0, "use_hop_count": False}}
    assert load_genome(write(result)) == some


@pytest.mark.parametrize(
    "text, message",
    [
        ("{", r"no JSON.*write one object such as"),
        ("[1, 2]", r"holds a list; write one JSON object"),
        ('{"p_forget": 0.1}', r"names 'p_forget'; allowed names are density_of_robots, "),
        ('{"p_vector_forget": 1.2}', r"p_vector_forget must be between 0 and 1.*\(got 1\.2\)"),
        ('{"p_vector_forget": 1e999}', r"no JSON \(no float holds 1e999\)"),
        ('{"p_vector_forget": "0.1"}', r"p_vector_forget must be .*\(got '0\.1'\)"),
        ('{"p_vector_forget": true}', r"p_vector_forget must be .*\(got True\)"),
        ('{"use_hop_count": 1}', r"use_hop_count must be true or false.*\(got 1\)"),
    ],
)
def test_broken_files(write, text, message):
    path = write(text)
    with pytest.raises(UserError, match=message) as caught:
        load_genome(path)
    assert path in str(caught.value)
    assert "\n" not in str(caught.value)


def test_bytes_that_are_no_text(tmp_path):
    path = tmp_path / "genome.json"
    path.write_bytes(b"\xff\xfe\x00{}")
    with pytest.raises(UserError, match="is no text"):
        load_genome(str(path))


@pytest.mark.parametrize("name", ["type3", "missing.json", "", "."])
def test_unknown_names(name):
    message = r"a preset \(type1, type2, evolved\) or the path of a JSON file"
    with pytest.raises(UserError, match=message) as caught:
        load_genome(name)
    assert ("there is no file" in str(caught.value)) == (name == "missing.json")


def test_the_evolved_preset_is_the_best_genome_of_the_search():
    """It has the digits of Table 2."""
    best = Path(__file__).parents[2] / "results/default" / "evolve-paper" / "best.json"
    expected = astuple(load_genome(str(best)))
    for value, expected_value in zip(astuple(PRESETS["evolved"]), expected, strict=True):
        assert type(value) is type(expected_value)
        assert value == pytest.approx(expected_value, abs=1e-3)
