"""Files of a user's module: those that it imports from beside it, and nobody else's."""

import importlib
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import get_type_hints

import pytest

from iswarm_mj.strategy.library import find_strategy, find_teams
from iswarm_mj.strategy.user_files import import_file, sources
from iswarm_mj.utils.errors import UserError

ROOT = Path(__file__).parents[2]
MAIN = """
import numpy, iswarm_mj.config.swarm
from beside import one
def late():
    import pack.deep as d
"""
FILES = {
    "main.py": MAIN,
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
    """Directory of the files, on the path."""
    for name, text in FILES.items():
        (tmp_path / name).parent.mkdir(exist_ok=True, parents=True)
        (tmp_path / name).write_text(text)
    monkeypatch.syspath_prepend(tmp_path)
    return tmp_path


def test_all_that_is_imported_is_found(folder):
    first, *imported = [
        str(path.relative_to(folder.resolve())) for path in sources(folder / "main.py")
    ]
    assert first == "main.py"
    assert sorted(imported) == sorted({*FILES} - {"main.py", "unused.py"})


def test_a_file_that_imports_nothing_is_alone(folder):
    assert sources(folder / "unused.py") == [(folder / "unused.py").resolve()]


STRATEGY = """
from dataclasses import dataclass

from helpers import STEP


@dataclass(frozen=True)
class Walk:
    step: float = STEP
"""


def write_walk(directory, step):
    """Write a strategy whose step is stated in a file beside it; return how it is named."""
    directory.mkdir(exist_ok=True)
    (directory / "walk.py").write_text(STRATEGY)
    (directory / "helpers.py").write_text(f"STEP = {step}\n")
    return f"{directory}/walk.py:Walk"


class TestImports:
    """Users' files can import what lies beside them; other code does not find them."""

    @pytest.fixture(autouse=True)
    def modules(self):
        """Modules without those of users' files, which other tests may have left, too."""
        self.forget_users_modules()
        yield
        self.forget_users_modules()

    @staticmethod
    def forget_users_modules():
        for name in [*sys.modules]:
            if name.startswith(("walk", "helpers", "other")):
                del sys.modules[name]

    def test_a_file_imports_its_neighbours(self, tmp_path):
        assert find_strategy(write_walk(tmp_path, 7.0)).step == 7.0

    def test_other_code_does_not_find_them(self, tmp_path):
        """Numba looks for `coverage`, which a user may have as a file."""
        name = write_walk(tmp_path, 7.0)
        (tmp_path / "other.py").write_text("")
        path = [*sys.path]
        find_strategy(name)
        assert sys.path == path
        with pytest.raises(ModuleNotFoundError, match="other"):
            importlib.import_module("other")
        with pytest.raises(ModuleNotFoundError, match="walk"):
            importlib.import_module("walk")

    def test_the_path_is_as_before_after_an_error(self, tmp_path):
        name = write_walk(tmp_path, "1 / 0")
        path = [*sys.path]
        with pytest.raises(
            UserError, match=r"ZeroDivisionError.*helpers\.py, line 1: `STEP = 1 / 0`"
        ):
            find_strategy(name)
        assert sys.path == path

    def test_files_of_one_name_do_not_mix(self, tmp_path):
        names = [write_walk(tmp_path / f"{step:.0f}", step) for step in (1.0, 2.0, 3.0)]
        first, second, third = map(find_strategy, names)
        assert [cls.step for cls in (first, second, third)] == [1.0, 2.0, 3.0]
        assert len({cls.__module__ for cls in (first, second, third)}) == 3
        assert [sys.modules[cls.__module__].Walk for cls in (first, second, third)] == [
            *(first, second, third)
        ]

    def test_a_module_of_the_users_own_stays_theirs(self, tmp_path, monkeypatch):
        """A notebook has imported another file of the same name, and imports it again."""
        write_walk(tmp_path / "notebook", 1.0)
        monkeypatch.syspath_prepend(tmp_path / "notebook")
        helpers = importlib.import_module("helpers")
        assert find_strategy(write_walk(tmp_path / "files", 2.0)).step == 2.0
        assert importlib.import_module("helpers") is helpers and helpers.STEP == 1.0

    def test_an_edited_file_is_read_again(self, tmp_path):
        name = write_walk(tmp_path, 7.0)
        first = find_strategy(name)
        text = STRATEGY.replace("step: float = STEP", "step: float = 10 * STEP")
        (tmp_path / "walk.py").write_text(text)
        assert (find_strategy(name).step, first.step) == (70.0, 7.0)

    def test_a_file_is_read_once_while_it_stays_the_same(self, tmp_path):
        """Objects of its classes are equal then."""
        name = write_walk(tmp_path, 7.0)
        first = find_strategy(name)
        assert find_strategy(name) is first
        assert find_strategy(name)(step=2.0) == first(step=2.0)

    def test_a_neighbour_may_be_new(self, tmp_path):
        """Python keeps lists of directories, which a file may be younger than."""
        name = write_walk(tmp_path, 7.0)
        find_strategy(name)
        (tmp_path / "other.py").write_text("STEP = 8.0\n")
        (tmp_path / "walk.py").write_text(STRATEGY.replace("helpers", "other"))
        assert find_strategy(name).step == 8.0

    def test_annotations_may_be_texts(self, tmp_path):
        """Types of fields are looked up in the module of their class."""
        future = "from __future__ import annotations\n"
        name = write_walk(tmp_path, 7.0)
        (tmp_path / "walk.py").write_text(future + STRATEGY)
        assert get_type_hints(find_strategy(name))["step"] is float

    def test_other_processes_find_them(self, tmp_path):
        """Gymnasium gives environments to processes by cloudpickle."""
        cloudpickle = pytest.importorskip("cloudpickle")
        walk = find_strategy(write_walk(tmp_path, 7.0))
        (tmp_path / "pickled").write_bytes(cloudpickle.dumps(walk(step=8.0)))
        code = "import cloudpickle, sys; walk = cloudpickle.load(open(sys.argv[1], 'rb')); "
        code += "print(type(walk).__name__, walk.step, type(walk)().step)"
        done = subprocess.run(
            [sys.executable, "-c", code, str(tmp_path / "pickled")],
            cwd=ROOT,
            capture_output=True,
            text=True,
            check=True,
        )
        assert done.stdout.split() == ["Walk", "8.0", "7.0"]


def test_files_beside_it_are_found_though_others_are_imported(tmp_path):
    for step in (1.0, 2.0):
        find_strategy(write_walk(tmp_path / f"{step:.0f}", step))
    files = [(tmp_path / "2" / name).resolve() for name in ("walk.py", "helpers.py")]
    assert sources(tmp_path / "2" / "walk.py") == files


def test_teams_of_one_strategy_are_numbered(tmp_path):
    (tmp_path / "walks.py").write_text("class Walk:\n    pass\n\nclass Walker(Walk):\n    pass\n")
    words = ("Walk=1", "Walker=4", "Walk=.5", "Walk=0.25")
    teams = find_teams([f"{tmp_path}/walks.py:{word}" for word in words])
    assert {name: (share, cls.__name__) for name, (share, cls) in teams.items()} == {
        "Walk": (1, "Walk"),
        "Walker": (4, "Walker"),
        "Walk2": (0.5, "Walk"),
        "Walk3": (0.25, "Walk"),
    }


def test_two_threads_execute_a_file_once(tmp_path):
    file = tmp_path / "slow.py"
    file.write_text("import time\ntime.sleep(0.2)\n")
    with ThreadPoolExecutor(2) as pool:
        first, second = pool.map(import_file, [file, file])
    assert first is second
