"""Tasks of users, with areas, and derived from cleaning, on all engines and in all ways to play."""

import pytest
from support.matrix import cells_of, play
from support.matrix_checks import check


@pytest.mark.parametrize("cell", cells_of("own", "areas", "cleaning"))
def test_a_cell(cell):
    check(cell, play(cell))
