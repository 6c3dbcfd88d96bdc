"""Edges of what studies select: changes by raw p-values, tables of another engine."""

from types import SimpleNamespace

import pytest

from iswarm_mj.experiments.analysis.statistics import Interval
from iswarm_mj.experiments.report import numbers
from iswarm_mj.experiments.report.reproduce import Part
from iswarm_mj.utils import tables
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.tables import write_table


def test_changes_are_listed_by_their_raw_p_values(monkeypatch):
    effect = Interval(1.0, 0.5, 2.0)
    change = SimpleNamespace(p=0.005, adjusted=0.05, choice="c", value="1", reached="1/1", effect=effect)
    monkeypatch.setattr(numbers, "changes", lambda rows: [change])
    assert "| c |" in numbers.sensitivity([]).replace("`", "")


def test_studies_with_an_engine_of_their_own_are_not_made_with_another(tmp_path):
    for name, lacks in (("time-step", "made with another engine"), ("density", "")):
        (tmp_path / name).mkdir()
        write_table(tmp_path / name / "t.parquet", [{"a": 1}], {"engine": "mujoco"})
        assert Part(name, "t.parquet", {"engine": "planar"}, None).lacks(tmp_path) == lacks


def test_tables_with_too_many_values_are_refused(tmp_path, monkeypatch):
    write_table(tmp_path / "t.parquet", [{"a": 1, "b": 2, "c": 3}] * 2, {})
    monkeypatch.setattr(tables, "MOST_VALUES", 5)
    with pytest.raises(UserError):
        tables.read_table(tmp_path / "t.parquet")
