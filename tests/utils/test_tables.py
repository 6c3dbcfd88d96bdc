"""Tables and figures: what is written is read back, and other files are refused in a sentence."""

import pyarrow as pa
import pyarrow.parquet
import pytest

from iswarm_mj._version import __version__
from iswarm_mj.output.plot_style import figure
from iswarm_mj.utils import tables
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.tables import read_table, write_table

ROWS = [{"name": "a", "value": 1.5, "count": 3}, {"name": "b", "value": None, "count": -1}]
REFUSED = "not a readable table"


@pytest.fixture
def path(tmp_path):
    """Return the path of a table that is to be written."""
    return tmp_path / "t.parquet"


class TestTable:
    def test_it_comes_back_with_its_settings_and_a_csv_file_beside_it(self, path):
        write_table(path, ROWS, {"seed": 4, "config": {"x": [1, 2]}}, csv=True)
        rows, settings = read_table(path)
        assert rows == ROWS
        assert settings == {"version": __version__, "seed": 4, "config": {"x": [1, 2]}}
        csv_lines = path.with_suffix(".csv").read_text().splitlines()
        assert csv_lines == ['"name","value","count"', '"a",1.5,3', '"b",,-1']

    def test_of_no_file_is_refused(self, path):
        with pytest.raises(UserError, match=REFUSED):
            read_table(path)

    @pytest.mark.parametrize("content", [b"", b"PAR1 nothing PAR1"])
    def test_of_other_content_is_refused(self, path, content):
        path.write_bytes(content)
        with pytest.raises(UserError, match=REFUSED):
            read_table(path)

    def test_of_another_program_is_refused(self, path):
        """It lacks the metadata."""
        pyarrow.parquet.write_table(pa.table({"x": [1]}), path)
        with pytest.raises(UserError, match=REFUSED):
            read_table(path)

    def test_of_too_many_values_is_refused(self, path, monkeypatch):
        write_table(path, ROWS, {})
        monkeypatch.setattr(tables, "MAX_VALUES", 6)
        assert len(read_table(path)[0]) == 2
        monkeypatch.setattr(tables, "MAX_VALUES", 5)
        with pytest.raises(UserError, match=REFUSED):
            read_table(path)


def test_a_figure_is_png_and_svg_and_repeats(tmp_path):
    for name in ("a", "b"):
        with figure(tmp_path / name, columns=2) as (left, right):
            left.plot([1, 2], [3, 4])
            right.set_xlabel("x")
    for suffix in (".png", ".svg"):
        assert (tmp_path / f"a{suffix}").read_bytes() == (tmp_path / f"b{suffix}").read_bytes()
    assert (tmp_path / "a.png").read_bytes().startswith(b"\x89PNG")
    assert len(list(tmp_path.iterdir())) == 4
