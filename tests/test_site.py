"""The documentation: its tables are those of the code, its commands work, the site builds without
the network."""

import importlib
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from make_tables import BLOCK, MAKERS, filled

from iswarm_mj.commands.main import parse
from iswarm_mj.strategy.interface import Observation
from iswarm_mj.utils.errors import FaultKind

ROOT = Path(__file__).parents[1]
PAGES = sorted([ROOT / "README.md", *(ROOT / "docs").glob("*.md")])
NAMING = [*PAGES, ROOT / "CONTRIBUTING.md", ROOT / "results/README.md"]


def commands(page):
    """The commands of `iswarm` in a page's blocks, without their comments."""
    blocks = re.findall(r"```bash\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL)
    lines = "\n".join(blocks).replace("\\\n", " ").splitlines()
    parts = [part for line in lines for part in re.split(r"\s&&\s", line)]
    return [
        shlex.split(part, comments=True) for part in parts if part.strip().startswith("iswarm ")
    ]


ALL = [(page.name, shlex.join(words)) for page in PAGES for words in commands(page)]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_tables_that_the_code_determines_are_up_to_date(page):
    text = page.read_text(encoding="utf-8")
    assert filled(text) == text, "run `python tools/make/make_tables.py`"


def test_each_table_is_on_a_page_and_complete():
    text = "".join(page.read_text(encoding="utf-8") for page in PAGES)
    assert {name for _, name, _ in BLOCK.findall(text)} == set(MAKERS)
    faults = (ROOT / "docs/faults.md").read_text(encoding="utf-8")
    assert [kind.name for kind in FaultKind if f"| `{kind.name}` |" not in faults] == []
    observed = (ROOT / "docs/observation.md").read_text(encoding="utf-8")
    assert [name for name in Observation._fields if f"| `{name}` |" not in observed] == []


@pytest.mark.parametrize("page", NAMING, ids=lambda page: page.name)
def test_what_a_page_names_exists(page):
    """Files, and what code blocks import."""
    text = page.read_text(encoding="utf-8")
    named = re.findall(r"\b((?:tests|docs|iswarm_mj|models|notebooks|tools)/[\w./-]*\w)", text)
    assert [name for name in named if not (ROOT / name).exists()] == []
    assert named or page.name != "architecture.md"
    blocks = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    for module, names in re.findall(
        r"^from (iswarm_mj[\w.]*) import (.+)$", "\n".join(blocks), re.MULTILINE
    ):
        found = importlib.import_module(module)
        assert all(hasattr(found, name.strip()) for name in names.split(","))


@pytest.fixture
def example(tmp_path, monkeypatch):
    """A directory with the files that pages name."""
    strategies = (ROOT / "docs/strategies.md").read_text(encoding="utf-8")
    (tmp_path / "walk.py").write_text(
        re.search(r"```python\n(# walk.py.*?)```", strategies, re.S)[1]
    )
    tasks = (ROOT / "docs/tasks.md").read_text(encoding="utf-8")
    for name in ("gather.py", "closing.py"):
        (tmp_path / name).write_text(re.search(rf"```python\n(# {name}.*?)```", tasks, re.S)[1])
    (tmp_path / "boxes.toml").write_text(re.search(r"```toml\n(.*?)```", tasks, re.S)[1])
    policies = (ROOT / "docs/policies.md").read_text(encoding="utf-8")
    (tmp_path / "turner.py").write_text(
        re.search(r"```python\n(# turner.py.*?)```", policies, re.S)[1]
    )
    start = (ROOT / "docs/quick-start.md").read_text(encoding="utf-8")
    (tmp_path / "run.toml").write_text(re.search(r"```toml\n(.*?)```", start, re.S)[1])
    training = (ROOT / "docs/training.md").read_text()
    for name in ("lamp.py", "learned.py"):
        (tmp_path / name).write_text(re.search(rf"```python\n(# {name}.*?)```", training, re.S)[1])
    np.save(tmp_path / "lamp.npy", np.zeros((30, 2), np.float32))  # which learn.py makes
    (tmp_path / "my-genome.json").write_text('{"p_vector_forget": 0.2, "use_hop_count": true}')
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    (tmp_path / "models").symlink_to(ROOT / "models")
    (tmp_path / "tools").symlink_to(ROOT / "tools")
    (tmp_path / "large.xml").symlink_to(ROOT / "models/robot.xml")  # which an example makes
    (tmp_path / "my_robot.xml").symlink_to(ROOT / "models/robot6.xml")
    (tmp_path / "results").symlink_to(ROOT / "results")
    monkeypatch.chdir(tmp_path)
    return tmp_path


INSTALLED = (
    "--strategy type2",
    "--strategy neural",
    "runs/neural",
    "--task aggregation",
    "--task foraging",
)
"""Parts of commands that need the package to be installed, not only to be found, or what such a
command writes."""


@pytest.mark.parametrize(("page", "command"), ALL)
def test_commands_are_understood(page, command, example, monkeypatch):
    words = shlex.split(command)[1:]
    if any(part in command for part in INSTALLED) or (
        "--config" in words and "result.json" in command
    ):
        pytest.skip("needs what another command writes; the slow test runs it")
    if "--help" in words:
        with pytest.raises(SystemExit) as end:
            parse(words)
        assert end.value.code == 0
    else:
        if "--worlds 1024" in command:  # which is for a GPU
            monkeypatch.setattr("iswarm_mj.engines.settings.can_use_warp", lambda: True)
        parsed = parse(words)
        if hasattr(parsed, "number_of_robots"):
            parsed.number_of_robots()


QUICK = {
    "clean": "--steps 12",
    "run": "--steps 12",
    "bench": "--steps 4 --warm-up 2 --worlds 2",
    "grasp": "--repeats 1 --radius 20e-6",
    "evolve": "--generations 2 --population 4 --steps 10",
    "train": "--generations 2 --population 4 --steps 10",
    "experiment": "--quick",
    "reproduce": "--quick",
    "replay": "--last 3",
}
"""What makes a command short, where it is not."""


def shortened(words, flags):
    """A command with these flags in place of its own of the same names."""
    names, kept, is_replaced = {flag for flag in flags if flag.startswith("--")}, [], False
    for word in words:
        is_replaced = word in names if word.startswith("--") else is_replaced
        kept += [] if is_replaced else [word]
    return [*kept, *flags]


def run(arguments):
    command = [sys.executable, "-m", "iswarm_mj", *arguments]
    done = subprocess.run(
        command, capture_output=True, text=True, env=os.environ | {"PYTHONPATH": str(ROOT)}
    )
    assert done.returncode == 0, f"{shlex.join(arguments)}: {done.stderr}"


@pytest.mark.slow
@pytest.mark.parametrize(
    "page", [page for page in PAGES if commands(page)], ids=lambda page: page.name
)
def test_commands_run(page, example):
    """One after the other, as a reader types them, with fewer steps and runs."""
    run(["clean", "--steps", "101"])  # what pages look at
    for words in commands(page):
        if (
            "--help" in words
            or words[1] == "play"
            or any(part in shlex.join(words) for part in INSTALLED)
        ):
            continue  # a page is there until it is interrupted
        more = QUICK.get(words[1], "").split() if "--force-curve" not in words else []
        if "--worlds" in words and "--worlds" not in more:
            more += ["--worlds", "3"]
        if "--replicates" in words:
            more += ["--replicates", "2"]
        if words[1] == "picture":
            more += ["--width", "64", "--height", "64", "--step", "5"]
        out = [part for part in words if part.startswith("docs/")]
        run(shortened([part if part not in out else "picture.png" for part in words[1:]], more))


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", ["quick-start.md", "strategies.md", "tasks.md", "files.md", "environments.md"]
)
def test_python_runs(name, example):
    """Blocks as a reader copies them, with fewer steps and robots, after the page's commands for
    what they load."""
    page = ROOT / "docs" / name
    text = page.read_text(encoding="utf-8")
    files = ("# walk", "# gather", "# closing")
    blocks = [
        block
        for block in re.findall(r"```python\n(.*?)```", text, re.DOTALL)
        if not block.startswith(files)
    ]
    made = {words[-1]: words[1:] for words in commands(page) if words[-2] == "--out"}
    for out in sorted(set(re.findall(r'"(runs/\w+)"', "".join(blocks)))):
        run(
            shortened(
                made.get(out, ["clean", "--engine", "planar"]), ["--robots", "20", "--steps", "12"]
            )
        )
    for block in blocks:
        for old, new in (
            ("steps=200", "steps=3"),
            ("range(50)", "range(2)"),
            ("num_envs=64, n_robots=20", "num_envs=2, n_robots=4"),
            ("jax.random.key(0), 64", "jax.random.key(0), 2"),
            ("zeros((64, ", "zeros((2, "),
            ("steps=800", "steps=4"),
            ("n_robots=280", "n_robots=20"),
            ("not run.is_over", "run.step < 4"),
        ):
            block = block.replace(old, new)
        environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(ROOT), str(example)])}
        done = subprocess.run(
            [sys.executable, "-c", block], capture_output=True, text=True, env=environment
        )
        assert done.returncode == 0, f"{block}: {done.stderr}"
    assert blocks


@pytest.mark.slow
class TestSite:
    @pytest.fixture(scope="class")
    @classmethod
    def site(cls, tmp_path_factory):
        """The site, built where mkdocs is installed (the extra docs)."""
        pytest.importorskip("material")
        from mkdocs.commands.build import build
        from mkdocs.config import load_config

        out = tmp_path_factory.mktemp("site")
        build(load_config(str(ROOT / "mkdocs.yml"), site_dir=str(out), strict=True))
        return out

    def test_it_loads_nothing_from_elsewhere(self, site):
        pages = sorted(site.glob("*.html"))
        assert len(pages) >= len(PAGES) - 1
        for page in pages:
            loaded = re.findall(
                r"<(?:script|img|link|iframe)\b[^>]*>", page.read_text(encoding="utf-8")
            )
            assert [
                tag for tag in loaded if re.search(r"""(?:src|href)=["']?(?:https?:)?//""", tag)
            ] == []

    def test_figures_and_reference_are_there(self, site):
        assert list((site / "figures").rglob("*.png"))
        text = (site / "api.html").read_text(encoding="utf-8")
        assert all(
            f'id="iswarm_mj.{name}"' in text
            for name in ("Run.advance", "load", "envs.single_env", "gripper.grasp_voltage")
        )
        assert "Take the next control steps" in text
