"""What files of others can do, by the code that reads them; and what listens."""

import ast
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

import iswarm_mj
from iswarm_mj.experiments.report.numbers import text

ROOT = Path(iswarm_mj.__file__).parent
FORBIDDEN_MODULES = {"pickle", "marshal", "shelve", "dill", "cloudpickle", "yaml"}
NETWORK = {"socket", "socketserver", "http", "http.server", "asyncio", "xmlrpc", "urllib.request", "ssl"}
FORBIDDEN_CALLS = {"eval", "exec", "compile", "__import__"}
LOADS_CODE = {"strategy/library.py"}
"""A strategy's file is code; it is executed because the user names it."""


def calls(tree):
    for node in ast.walk(tree):
        if isinstance(node, ast.Call):
            yield ast.unparse(node.func), {word.arg: ast.unparse(word.value) for word in node.keywords}


@pytest.mark.parametrize("folder", sorted({path.parent for path in ROOT.rglob("*.py")}), ids=lambda path: path.name)
def test_nothing_that_is_read_is_executed(folder):
    for path in folder.glob("*.py"):
        check(ast.parse(path.read_text(encoding="utf-8")), str(path.relative_to(ROOT)))


def check(tree, name):
    """Assert that a module neither runs what it reads, nor listens."""
    for node in ast.walk(tree):
        modules = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
        modules += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
        assert not FORBIDDEN_MODULES.intersection(modules), modules
        assert not NETWORK.intersection(modules), modules
    for function, words in calls(tree):
        assert function not in FORBIDDEN_CALLS and not function.startswith(("pickle.", "joblib.load")), function
        assert words.get("allow_pickle", "False") == "False" and words.get("shell", "False") == "False"
        assert not function.endswith(("exec_module", "runpy.run_path")) or name in LOADS_CODE


@given(st.text())
def test_text_is_no_markup(words):
    shown = text(words)
    assert "\n" not in shown and "](" not in shown
    assert "<a" not in shown and "<!" not in shown and "</" not in shown
    assert "|" not in shown.replace("\\|", "")


def test_words_by_hand():
    assert text("p < 0.001 | a") == "p < 0.001 \\| a"
    assert text("<script>x</script> ![i](http://a)") == "&lt;script>x&lt;/script> ![i]\\(http://a)"
