"""What README and docs point to is there."""

import importlib
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PAGES = ["README.md", "CONTRIBUTING.md", "results/README.md", *(f"docs/{p.name}" for p in (ROOT / "docs").glob("*.md"))]


@pytest.mark.parametrize("page", PAGES)
def test_files_that_are_named_exist(page):
    named = re.findall(r"\b((?:tests|docs|iswarm_mj|models|notebooks|tools)/[\w./-]*\w)", (ROOT / page).read_text())
    missing = [name for name in named if not (ROOT / name).exists()]
    assert missing == []
    assert named or page != "docs/architecture.md"


@pytest.mark.parametrize("page", PAGES)
def test_imports_in_code_blocks_work(page):
    blocks = re.findall(r"```python\n(.*?)```", (ROOT / page).read_text(), re.DOTALL)
    for module, names in re.findall(r"^from (iswarm_mj[\w.]*) import (.+)$", "\n".join(blocks), re.MULTILINE):
        found = importlib.import_module(module)
        assert all(hasattr(found, name.strip()) for name in names.split(","))
