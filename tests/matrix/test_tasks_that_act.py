"""Tasks that drive boxes, let robots die and change conditions, on all engines and in all ways."""

import pytest
from support.matrix import cells_of, play
from support.matrix_checks import check


@pytest.mark.parametrize("cell", cells_of("boxes", "deaths", "conditions", "everything"))
def test_a_cell(cell):
    check(cell, play(cell))
