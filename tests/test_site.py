"""The documentation: its tables follow the code, its commands work, and the site builds."""

import importlib
import os
import re
import shlex
import subprocess
import sys
import unicodedata
from pathlib import Path

import numpy as np
import pytest
from make_tables import BLOCK, MAKERS, filled

from iswarm_mj.commands.main import parse
from iswarm_mj.strategy.interface import Observation
from iswarm_mj.utils.errors import FaultKind

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
PAGES = sorted([ROOT / "README.md", *DOCS.glob("*.md")])
NAMING = [*PAGES, ROOT / "CONTRIBUTING.md", ROOT / "results/README.md"]
"""Pages that name files and modules."""


def blocks_of(page, language):
    """Return the code blocks of a page in a language."""
    return re.findall(rf"```{language}\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL)


def commands(page):
    """Return the commands of `iswarm` in a page's blocks, as words without their comments."""
    lines = "\n".join(blocks_of(page, "bash")).replace("\\\n", " ").splitlines()
    found_commands = []
    for line in lines:
        for part in re.split(r"\s&&\s", line):
            if part.strip().startswith("iswarm "):
                found_commands.append(shlex.split(part, comments=True))
    return found_commands


COMMANDS = [(page.name, shlex.join(words)) for page in PAGES for words in commands(page)]
"""Page and text of each command."""


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
def test_names_on_a_page_exist(page):
    """These are paths of files, and what code blocks import."""
    text = page.read_text(encoding="utf-8")
    paths = re.findall(r"\b((?:tests|docs|iswarm_mj|models|notebooks|tools)/[\w./-]*\w)", text)
    assert [path for path in paths if not (ROOT / path).exists()] == []
    assert paths or page.name != "architecture.md"

    code = "\n".join(blocks_of(page, "python"))
    imports = re.findall(r"^from (iswarm_mj[\w.]*) import (.+)$", code, re.MULTILINE)
    for module_name, names in imports:
        module = importlib.import_module(module_name)
        for name in names.split(","):
            assert hasattr(module, name.strip()), name


def anchors_of(page):
    """Return the anchors of a page's headings, as the site makes them."""
    text = re.sub(r"```.*?```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    headings = re.findall(r"^#+ (.+)$", text, re.MULTILINE)
    anchors = set()
    for heading in headings:
        ascii_heading = unicodedata.normalize("NFKD", heading).encode("ascii", "ignore").decode()
        words = re.sub(r"[^\w\s-]", "", ascii_heading).strip().lower()
        anchors.add(re.sub(r"[-\s]+", "-", words))
    return anchors


@pytest.mark.parametrize("page", [*NAMING, ROOT / "CHANGELOG.md"], ids=lambda page: page.name)
def test_links_lead_to_pages_and_their_headings(page):
    links = re.findall(r"\]\(([\w./-]*\.md)?(?:#([\w.-]+))?\)", page.read_text(encoding="utf-8"))
    for name, anchor in links:
        target = page.parent / name if name else page
        assert target.exists(), name
        if anchor and target.name != "api.md":
            assert anchor in anchors_of(target), f"{name}#{anchor}"


def test_the_rates_on_the_first_page_are_those_on_the_page_on_performance():
    performance = (DOCS / "performance.md").read_text(encoding="utf-8")
    first_page = (DOCS / "index.md").read_text(encoding="utf-8")

    row = r"the default, `--refinement 2` \| ([\d.]+), [\d.]+ %; ([\d.]+) mm \|.*\| ([\d.]+) \|"
    share, deepest, core_ms = re.search(row, performance).groups()
    assert f"**{283 / float(core_ms):.0f},000** robots" in first_page
    assert f"**{deepest} mm** is the deepest overlap" in first_page
    assert f"{float(share):.2f} % of them are deeper than 0.05 mm" in first_page

    gpu_ms = re.search(r"1024 worlds of 283 robots take ([\d.]+) ms each", performance)[1]
    assert f"**{1024 * 283 / float(gpu_ms) / 1e3:.0f} million** on one H200" in first_page
    assert f"| {gpu_ms} ms | no GPU |" in first_page

    many_ms = re.search(r"with 1000 robots \(([\d.]+) and", performance)[1]
    assert f"a control step | {core_ms} ms | 4.4 ms |" in first_page
    assert f"a control step | {many_ms} ms | 27 ms |" in first_page


PROGRAMS = {
    "walk.py": "strategies.md",
    "gather.py": "tasks.md",
    "closing.py": "tasks.md",
    "turner.py": "policies.md",
    "lamp.py": "training.md",
    "learned.py": "training.md",
}
"""Python files that commands name, with the pages that show them."""
SETTINGS = {"boxes.toml": "tasks.md", "run.toml": "quick-start.md"}
"""TOML files that commands name, with the pages that show them, first of all."""
LINKS = {
    "examples": "examples",
    "models": "models",
    "tools": "tools",
    "results": "results",
    "my_robot.xml": "models/robot6.xml",
    "large.xml": "models/robot.xml",
}
"""Files that commands name, with those that stand for them; an example writes large.xml."""


@pytest.fixture
def example(tmp_path, monkeypatch):
    """A directory with the files that pages name."""
    for name, page in PROGRAMS.items():
        (program,) = [
            block for block in blocks_of(DOCS / page, "python") if block.startswith(f"# {name}")
        ]
        (tmp_path / name).write_text(program)
    for name, page in SETTINGS.items():
        (tmp_path / name).write_text(blocks_of(DOCS / page, "toml")[0])
    for name, target in LINKS.items():
        (tmp_path / name).symlink_to(ROOT / target)
    (tmp_path / "my-genome.json").write_text('{"p_vector_forget": 0.2, "use_hop_count": true}')

    weights_of_learn = np.zeros((30, 2), np.float32)
    np.save(tmp_path / "lamp.npy", weights_of_learn)
    monkeypatch.chdir(tmp_path)
    return tmp_path


INSTALLED = (
    "--strategy type2",
    "--strategy neural",
    "runs/neural",
    "--task aggregation",
    "--task foraging",
)
"""Parts of commands that need the package to be installed, or what such a command writes."""


def needs_installation(words):
    """Return whether a command needs the package to be installed, not only to be found."""
    return any(part in shlex.join(words) for part in INSTALLED)


@pytest.mark.parametrize(("page", "command"), COMMANDS)
def test_commands_are_understood(page, command, example, monkeypatch):
    words = shlex.split(command)[1:]
    repeats_result = "--config" in words and re.search(r"result\.json|fit\.toml", command)
    if needs_installation(words) or repeats_result:
        pytest.skip("needs what another command writes; the slow test runs it")
    if "--help" in words:
        with pytest.raises(SystemExit) as end:
            parse(words)
        assert end.value.code == 0
        return

    is_for_gpu = "--worlds 1024" in command
    if is_for_gpu:
        monkeypatch.setattr("iswarm_mj.engines.settings.can_use_warp", lambda: True)
    parsed = parse(words)
    if hasattr(parsed, "number_of_robots"):
        parsed.number_of_robots()


SHORTENING_FLAGS = {
    "clean": "--steps 12",
    "run": "--steps 12",
    "bench": "--steps 4 --warm-up 2 --worlds 2",
    "grasp": "--repeats 1 --radius 20e-6",
    "tip": "--generations 2 --population 4",
    "evolve": "--generations 2 --population 4 --steps 10",
    "train": "--generations 2 --population 4 --steps 10",
    "experiment": "--quick",
    "reproduce": "--quick",
    "replay": "--last 3",
}
"""Flags that make long commands short."""


def shortened(words, flags):
    """Return a command with these flags in place of its own of the same names."""
    names = {flag for flag in flags if flag.startswith("--")}
    kept_words = []
    is_replaced = False
    for word in words:
        if word.startswith("--"):
            is_replaced = word in names
        if not is_replaced:
            kept_words.append(word)
    return [*kept_words, *flags]


def shortening_flags(words):
    """Return the flags that make a command short."""
    name = words[1]
    is_long = "--force-curve" not in words and (name != "tip" or "--optimise" in words)
    flags = SHORTENING_FLAGS.get(name, "").split() if is_long else []
    if "--worlds" in words and "--worlds" not in flags:
        flags += ["--worlds", "3"]
    if "--replicates" in words:
        flags += ["--replicates", "2"]
    if name == "picture":
        flags += ["--width", "64", "--height", "64", "--step", "5"]
    return flags


def run_python(arguments, *directories):
    """Run Python with arguments; it finds modules of the checkout and of further directories."""
    path = os.pathsep.join(map(str, (ROOT, *directories)))
    process = subprocess.run(
        [sys.executable, *arguments],
        capture_output=True,
        text=True,
        env=os.environ | {"PYTHONPATH": path},
    )
    assert process.returncode == 0, f"{shlex.join(arguments)}: {process.stderr}"


def run(arguments):
    """Run `iswarm` with arguments."""
    run_python(["-m", "iswarm_mj", *arguments])


@pytest.mark.slow
@pytest.mark.parametrize(
    "page", [page for page in PAGES if commands(page)], ids=lambda page: page.name
)
def test_commands_run(page, example):
    """They run one after the other, as a reader types them, with fewer steps and runs.

    The page of `iswarm play` is there until it is interrupted.
    """
    run_that_pages_look_at = ["clean", "--steps", "101"]
    run(run_that_pages_look_at)
    for words in commands(page):
        if "--help" in words or words[1] == "play" or needs_installation(words):
            continue
        arguments = ["picture.png" if word.startswith("docs/") else word for word in words[1:]]
        run(shortened(arguments, shortening_flags(words)))


CHROMIUM = "/usr/bin/chromium"
WIDER_TABLES = """
    [...document.querySelectorAll(".md-content table")]
        .filter((table) => table.getBoundingClientRect().right > innerWidth + 1)
        .map((table) => table.textContent.trim().slice(0, 40))
"""
"""Script that returns the beginnings of the tables that do not fit the window."""
SHORTER = {
    "steps=200": "steps=3",
    "range(50)": "range(2)",
    "num_envs=64, n_robots=20": "num_envs=2, n_robots=4",
    "jax.random.key(0), 64": "jax.random.key(0), 2",
    "zeros((64, ": "zeros((2, ",
    "steps=800": "steps=4",
    "n_robots=280": "n_robots=20",
    "not run.is_over": "run.step < 4",
}
"""Texts of Python on pages, and what makes them short."""


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", ["quick-start.md", "strategies.md", "tasks.md", "files.md", "environments.md"]
)
def test_python_runs(name, example):
    """Blocks run as a reader copies them, with fewer steps and robots.

    Before them run the page's commands that write what they load.
    """
    page = DOCS / name
    programs = ("# walk", "# gather", "# closing")
    blocks = [block for block in blocks_of(page, "python") if not block.startswith(programs)]
    assert blocks

    command_of_directory = {}
    for words in commands(page):
        if words[-2] == "--out":
            command_of_directory[words[-1]] = words[1:]
    for directory in sorted(set(re.findall(r'"(runs/\w+)"', "".join(blocks)))):
        command = command_of_directory.get(directory, ["clean", "--engine", "planar"])
        run(shortened(command, ["--robots", "20", "--steps", "12"]))

    for block in blocks:
        for text, short_text in SHORTER.items():
            block = block.replace(text, short_text)
        run_python(["-c", block], example)


def test_pictures_with_a_dark_variant_follow_the_page():
    pytest.importorskip("mkdocs")
    from mkdocs.structure.files import File, Files
    from mkdocs.structure.pages import Page
    from site_pictures import on_page_markdown

    config = {"site_dir": "site", "use_directory_urls": False, "docs_dir": str(DOCS)}
    names = ("page.md", "figures/results/plot.svg", "figures/results/plot-dark.svg", "film.webp")
    files = Files([File(name, str(DOCS), "site", use_directory_urls=False) for name in names])
    page = Page.__new__(Page)
    page.file = files.get_file_from_path("page.md")
    text = "![A plot](../results/plot.svg) ![A film](film.webp)"
    shown = on_page_markdown(text, page=page, files=files, config=config)
    name = "figures/results/plot"
    plot = f"![A plot]({name}.svg#only-light)![A plot]({name}-dark.svg#only-dark)"
    assert shown == f"{plot} ![A film](film.webp)"


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
            text = page.read_text(encoding="utf-8")
            for tag in re.findall(r"<(?:script|img|link|iframe)\b[^>]*>", text):
                assert not re.search(r"""(?:src|href)=["']?(?:https?:)?//""", tag), tag

    def test_figures_and_reference_are_there(self, site):
        assert list((site / "figures").rglob("*.png"))
        text = (site / "api.html").read_text(encoding="utf-8")
        for name in ("Run.advance", "load", "envs.single_env", "gripper.grasp_voltage"):
            assert f'id="iswarm_mj.{name}"' in text
        assert "Take the next control steps" in text

    def test_nothing_is_wider_than_a_phone(self, site):
        """Tables that do not fit are shown as lists."""
        sync_api = pytest.importorskip("playwright.sync_api")
        if not Path(CHROMIUM).exists():
            pytest.skip(f"needs {CHROMIUM}")
        with sync_api.sync_playwright() as playwright:
            browser = playwright.chromium.launch(
                executable_path=CHROMIUM, args=["--no-sandbox", "--disable-dev-shm-usage"]
            )
            phone = browser.new_page(viewport={"width": 390, "height": 800})
            n_lists = 0
            for page in sorted(site.glob("*.html")):
                phone.goto(page.as_uri())
                phone.wait_for_timeout(200)
                n_lists += phone.locator("[data-stacked]").count()
                assert phone.evaluate("document.documentElement.scrollWidth") == 390, page.name
                assert phone.evaluate(WIDER_TABLES) == [], page.name
            browser.close()
        assert n_lists > 20
