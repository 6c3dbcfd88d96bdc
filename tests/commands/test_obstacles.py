"""Obstacles by flags and files, and those that cannot be."""

from pathlib import Path

import pytest

from iswarm_mj.commands.main import parse
from iswarm_mj.config import ArenaConfig, SwarmConfig
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.engines.registry import find_engine
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.settings import RunSettings
from iswarm_mj.tasks.layout import free_cells
from iswarm_mj.utils.errors import UserError


def test_flags_and_files_say_the_same(tmp_path):
    path = tmp_path / "boxes.toml"
    path.write_text("[arena]\nobstacles = [[8, 8, 2, 0.5, 30], [0, 9, 1, 1, 0]]")
    numbers = ["8", "8", "2", "0.5", "30", "0", "9", "1", "1", "0"]
    by_file = parse(["clean", "--config", str(path)]).config
    assert by_file == parse(["clean", "--arena.obstacles", *numbers]).config
    assert by_file.arena.obstacles == ((8.0, 8.0, 2.0, 0.5, 30.0), (0.0, 9.0, 1.0, 1.0, 0.0))


WRONG = {
    "on the dump": ((3.0, 0.0, 1.0, 1.0, 0.0), r"arena.obstacles\[0\] must be outside the dump \(got"),
    "a corner on the dump": ((3.4, 3.4, 2.0, 0.5, 45.0 + 90.0), None),
    "turned onto the dump": ((3.4, 3.4, 2.0, 0.5, 45.0), r"arena.obstacles\[0\] must be outside the dump \(got"),
    "outside": ((24.0, 0.0, 1.0, 1.0, 0.0), r"arena.obstacles\[0\] must be inside the walls \(got"),
    "no number": ((8.0, float("nan"), 1.0, 1.0, 0.0), r"arena.obstacles\[0\] must be finite numbers x, y, half_x"),
    "negative": ((8.0, 8.0, -1.0, 1.0, 0.0), r"arena.obstacles\[0\] must be a box with half edges above 0 rd \(got"),
    "four numbers": ((8.0, 8.0, 1.0, 1.0), r"arena.obstacles must be boxes of 5 numbers each"),
}


@pytest.mark.parametrize("box, sentence", WRONG.values(), ids=WRONG)
def test_what_cannot_be(box, sentence):
    if sentence is None:  # it just misses the dump
        assert ArenaConfig(obstacles=(box,)).obstacles == (box,)
        return
    with pytest.raises(UserError, match=sentence):
        ArenaConfig(obstacles=(box,))


WRONG_BOXES = {
    "numbers": ((8, 8, 1, 1, 0, 1e-5), "arena.boxes must be boxes of 7 numbers each, .*friction"),
    "mass": (
        (8, 8, 1, 1, 0, -1e-5, 0.1),
        r"arena.boxes\[0\] must be a box with a mass from 1e-08 to 0.01 kg, or 0 where robots",
    ),
    "friction": ((8, 8, 1, 1, 0, 1e-5, -0.1), r"arena.boxes\[0\] must be a box with a coefficient of friction from 0"),
    "wall": ((24, 0, 1, 1, 0, 1e-5, 0.1), r"arena.boxes\[0\] must be inside the walls"),
    "obstacle": ((8, 8, 1, 1, 45, 1e-5, 0.1), r"arena.boxes\[0\] must be outside obstacles and other boxes"),
}


@pytest.mark.parametrize("box, sentence", WRONG_BOXES.values(), ids=WRONG_BOXES)
def test_boxes_that_cannot_be(box, sentence):
    with pytest.raises(UserError, match=sentence):
        ArenaConfig(obstacles=((9.0, 9.0, 0.5, 0.5, 0.0),), boxes=(box,))


def test_an_engine_without_boxes_refuses_them():
    engine = find_engine(f"{Path(__file__).parents[1]}/data/teleport.py:TeleportSettings")()
    config = SwarmConfig(ArenaConfig(boxes=((8, 8, 1, 1, 0, 1e-5, 0.1),)))
    with pytest.raises(UserError, match=r"arena.boxes must be left out with the engine teleport, which has none"):
        Run(config, settings=RunSettings(3, 5), engine=engine)


def test_no_room_is_left():
    around = (
        (0.0, 4.0, 7.4, 3.4, 0.0),
        (0.0, -4.0, 7.4, 3.4, 0.0),
        (4.0, 0.0, 3.4, 7.4, 0.0),
        (-4.0, 0.0, 3.4, 7.4, 0.0),
    )
    arena = ArenaConfig(size=15, dump_size=1, dust_area_size=2, dust_area_offset=5, obstacles=around)
    with pytest.raises(UserError, match=r"arena.obstacles must be such that a cell is left on which a robot can start"):
        free_cells(arena)


def test_no_obstacle_where_balls_lie():
    config = SwarmConfig(ArenaConfig(obstacles=((16.0, 0.0, 3.0, 3.0, 0.0),)))
    with pytest.raises(
        UserError, match=r"arena.obstacles must be outside the dust areas, .* \(12, 0\) .*\(got '16 0 3 3 0'\)"
    ):
        Run(config, settings=RunSettings(3, 5), engine=PlanarSettings())
