"""The picture of the layers shows the current imports."""

import importlib.util
from pathlib import Path

TOOL = Path(__file__).parents[1] / "tools" / "draw_floors.py"


def test_the_picture_is_up_to_date():
    spec = importlib.util.spec_from_file_location("draw_floors", TOOL)
    tool = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(tool)
    packages = tool.layers()
    assert tool.PICTURE.read_text() == tool.draw(packages), "run python tools/draw_floors.py"
    sizes, arrows = tool.count(packages)
    assert all(packages.index(above) < packages.index(below) for above, below in arrows)
    assert sizes["engines"] >= 10
