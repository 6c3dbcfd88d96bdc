"""Files of a user's module: those that it imports, from beside it and from packages, but nobody
else's."""

import sys

import numba
import pytest

from iswarm_mj.strategy.library import UserModuleFinder, find_strategy, find_teams, sources

FILES = {
    "main.py": "import numpy, iswarm_mj.config.swarm\nfrom beside import one\ndef late():\n    import pack.deep as d\n",
    "beside.py": "import json\nfrom iswarm_mj import Run\nimport nothing_of_that_name\n",
    "pack/__init__.py": "",
    "pack/deep.py": "from . import twin\n",
    "pack/twin.py": "import main\nimport pack.sub.leaf\n",
    "pack/sub/__init__.py": "import early\n",
    "pack/sub/leaf.py": "from ..value import one\n",
    "pack/value.py": "one = 1\n",
    "early.py": "",
    "unused.py": "",
}


@pytest.fixture
def folder(tmp_path, monkeypatch):
    for name, text in FILES.items():
        (tmp_path / name).parent.mkdir(exist_ok=True, parents=True)
        (tmp_path / name).write_text(text)
    monkeypatch.syspath_prepend(tmp_path)
    return tmp_path


def test_all_that_is_imported_is_found(folder):
    found = [str(path.relative_to(folder.resolve())) for path in sources(folder / "main.py")]
    assert found[0] == "main.py" and sorted(found) == sorted({*FILES} - {"unused.py"})


def test_a_file_that_imports_nothing_is_alone(folder):
    assert sources(folder / "unused.py") == [(folder / "unused.py").resolve()]


WALK = """
from dataclasses import dataclass

from twin_of_a_package import STEP
from iswarm_mj.strategy.vector_strategy import VectorStrategy


class coverage(VectorStrategy):
    step = STEP
"""


def test_only_users_import_what_is_beside_their_file(tmp_path):
    """A package that looks for a module which is not installed does not find a user's file of this
    name."""
    (tmp_path / "twin_of_a_package.py").write_text("STEP = 7\n")
    (tmp_path / "late_twin.py").write_text("")
    (tmp_path / "walk_of_a_package.py").write_text(WALK)
    assert find_strategy(f"{tmp_path}/walk_of_a_package.py:coverage").step == 7
    in_numba = {"__name__": "numba.misc"}
    for name in ("late_twin", "walk_of_a_package"):
        with pytest.raises(ModuleNotFoundError, match=name):
            exec(compile(f"import {name}", numba.__file__, "exec"), in_numba)
    assert UserModuleFinder.find_spec("package.late_twin", [str(tmp_path)]) is None
    assert str(tmp_path) not in sys.path
    assert (tmp_path / "twin_of_a_package.py").resolve() in sources(
        tmp_path / "walk_of_a_package.py",
    )


def test_teams_of_one_strategy_are_numbered(tmp_path):
    (tmp_path / "walks.py").write_text("class Walk:\n    pass\n\nclass Walker(Walk):\n    pass\n")
    found = find_teams(
        [f"{tmp_path}/walks.py:{word}" for word in ("Walk=1", "Walker=4", "Walk=.5", "Walk=0.25")],
    )
    assert {name: (share, own.__name__) for name, (share, own) in found.items()} == {
        "Walk": (1, "Walk"),
        "Walker": (4, "Walker"),
        "Walk2": (0.5, "Walk"),
        "Walk3": (0.25, "Walk"),
    }
