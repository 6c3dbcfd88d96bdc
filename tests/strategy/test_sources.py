"""Files of a user's module: those that it imports, from beside it and from packages, but nobody else's."""

import pytest

from iswarm_mj.strategy.sources import sources

FILES = {
    "main.py": "import numpy, iswarm_mj.config\nfrom beside import one\ndef late():\n    import pack.deep as d\n",
    "beside.py": "import json\nfrom iswarm_mj import Run\nimport nothing_of_that_name\n",
    "pack/__init__.py": "",
    "pack/deep.py": "from . import twin\nfrom .twin import value\n",
    "pack/twin.py": "import main\nvalue = 1\n",
    "unused.py": "",
}


@pytest.fixture
def folder(tmp_path, monkeypatch):
    for name, text in FILES.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    monkeypatch.syspath_prepend(tmp_path)
    return tmp_path


def test_all_that_is_imported_is_found(folder):
    found = [str(path.relative_to(folder.resolve())) for path in sources(folder / "main.py")]
    assert found[0] == "main.py" and sorted(found) == sorted({*FILES} - {"unused.py"})


def test_a_file_that_imports_nothing_is_alone(folder):
    assert sources(folder / "unused.py") == [(folder / "unused.py").resolve()]
