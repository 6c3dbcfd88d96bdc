"""Tables and figures: what is written is read back, and what cannot be read is refused in a
sentence."""

import pyarrow as pa
import pyarrow.parquet
import pytest

from iswarm_mj._version import __version__
from iswarm_mj.output.plot_style import figure
from iswarm_mj.utils import tables
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.tables import read_table, write_table

ROWS = [{"name": "a", "value": 1.5, "count": 3}, {"name": "b", "value": None, "count": -1}]


def test_a_table_comes_back_with_its_settings_and_a_csv_file_beside_it(tmp_path):
    write_table(tmp_path / "t.parquet", ROWS, {"seed": 4, "config": {"x": [1, 2]}}, csv=True)
    rows, settings = read_table(tmp_path / "t.parquet")
    assert rows == ROWS
    assert settings == {"version": __version__, "seed": 4, "config": {"x": [1, 2]}}
    assert (tmp_path / "t.csv").read_text().splitlines() == [
        '"name","value","count"',
        '"a",1.5,3',
        '"b",,-1',
    ]


@pytest.mark.parametrize("content", [None, b"", b"PAR1 nothing PAR1", pa.table({"x": [1]})])
def test_what_is_no_table_is_refused(tmp_path, content):
    path = tmp_path / "t.parquet"
    if isinstance(content, bytes):
        path.write_bytes(content)
    elif content is not None:
        pyarrow.parquet.write_table(content, path)
    with pytest.raises(UserError, match="not a readable table"):
        read_table(path)


def test_a_table_of_too_many_values_is_refused(tmp_path, monkeypatch):
    write_table(tmp_path / "t.parquet", ROWS, {})
    monkeypatch.setattr(tables, "MAX_VALUES", 6)
    assert len(read_table(tmp_path / "t.parquet")[0]) == 2
    monkeypatch.setattr(tables, "MAX_VALUES", 5)
    with pytest.raises(UserError, match="not a readable table"):
        read_table(tmp_path / "t.parquet")


def test_a_figure_is_png_and_svg_and_repeats(tmp_path):
    for name in ("a", "b"):
        with figure(tmp_path / name, columns=2) as (left, right):
            left.plot([1, 2], [3, 4])
            right.set_xlabel("x")
    for suffix in (".png", ".svg"):
        assert (tmp_path / f"a{suffix}").read_bytes() == (tmp_path / f"b{suffix}").read_bytes()
    assert (tmp_path / "a.png").read_bytes()[:4] == b"\x89PNG"
    assert len(list(tmp_path.iterdir())) == 4
