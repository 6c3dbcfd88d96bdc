"""Make the moving pictures of the documentation from seeds: docs/replays/ and docs/play.webp.

    python tools/make/make_gallery.py [NAME ...]

It runs each scene and writes what it looks like as an animated picture; of the first also a replay
that can be turned. It needs Debian's chromium, and `pip install playwright`.
"""

import argparse
import io
import runpy
import shlex
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import viser
from PIL import Image
from playwright.sync_api import Page as BrowserPage
from playwright.sync_api import sync_playwright

from iswarm_mj.commands.main import main as iswarm
from iswarm_mj.output.loading import load
from iswarm_mj.player.bench import Bench
from iswarm_mj.player.film import Film
from iswarm_mj.player.inputs import Inputs
from iswarm_mj.player.page import Page, close_server
from iswarm_mj.player.replay import swarm_film, write_replay
from iswarm_mj.player.scenario import PageScenario
from iswarm_mj.player.scene import STATE
from iswarm_mj.player.session import Session
from iswarm_mj.player.view import aim, light

ROOT = Path(__file__).parents[2]
OUT = ROOT / "docs" / "replays"
WIDTH = 640
"""Width of a picture [pixels]."""
HEIGHT = 480
"""Height of a picture [pixels]."""
PER_SECOND = 8
"""Pictures a second."""
MAX_BYTES = 300_000
"""Largest file of an animated picture; that of the page may have five times as many bytes."""
PORT = 8400
CHROMIUM = "/usr/bin/chromium"
CHROMIUM_FLAGS = [
    "--no-sandbox",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-dev-shm-usage",
]
N_PAGE_STEPS = 36
"""Control steps that the picture of the page shows."""


class Scene(NamedTuple):
    """A run, and what is shown of it."""

    command: str
    """Arguments of `iswarm`; "{directory}" stands for where `write_files` wrote."""
    film: Film


def example(file: str, task: str, strategy: str = "") -> str:
    """Return the flags of an example."""
    flags = f"--task examples/{file}.py:{task}"
    if strategy:
        flags += f" --strategy examples/{file}.py:{strategy}"
    return flags


def film(
    first: int,
    last: int,
    per_step: float = 1.0,
    colour_by: str = STATE,
    draw: tuple[str, ...] = (),
) -> Film:
    """Return a film of eight pictures a second.

    Args:
        first: control step with which it begins.
        last: control step with which it ends.
        per_step: pictures for each control step.
        colour_by: what colours the robots.
        draw: what else is drawn.
    """
    return Film(
        first=first,
        last=last,
        speed=PER_SECOND / per_step,
        frames_per_step=per_step,
        colour_by=colour_by,
        draw=draw,
    )


SMALL = "--arena.size 24 --arena.dust-area-offset 7 --arena.dust-area-size 5 --arena.n-dust 36"
MEDIUM = "--arena.size 30 --arena.dust-area-offset 9"
TWO_SIZES = "--arena.size 30 --arena.ball-radius-min 12e-6 --arena.ball-radius-max 28e-6"
BOXES = (
    "--arena.size 30 --arena.boxes 0 6 1 1 0 1e-5 0.004 -4 -4 0.8 1.5 10 1e-5 0.004 "
    "5 -8 0.8 0.8 0 8e-6 0.004"
)
SCENES = {
    "cleaning": Scene("clean --steps 100", film(60, 80, draw=("links",))),
    "hops": Scene(
        "clean --genome type2 --steps 100",
        film(60, 82, colour_by="hops to dump", draw=("links",)),
    ),
    "foraging": Scene(
        "run --task foraging --strategy forager --robots 60 --steps 150",
        film(110, 140, draw=("trails", "home")),
    ),
    "aggregation": Scene(
        "run --task aggregation --strategy beeclust --robots 120 --steps 410",
        film(0, 400, per_step=0.1),
    ),
    "contest": Scene(
        f"run {example('contest', 'Contest')} --strategy forager=0.5 type1=0.5 "
        "--robots 120 --steps 240",
        film(200, 230),
    ),
    "sort": Scene(
        f"run {example('sort', 'Sort', 'BySize')} --robots 80 --steps 200 {TWO_SIZES}",
        film(0, 160, per_step=0.25),
    ),
    "clusters": Scene(
        f"run {example('clusters', 'Clusters', 'Cluster')} --steps 3000",
        film(0, 3000, per_step=0.01),
    ),
    "boxes": Scene(
        f"run {example('boxes', 'Push', 'Sweep')} --robots 120 --steps 400 --seed 1 {BOXES}",
        film(0, 320, per_step=0.1),
    ),
    "explore": Scene(
        f"run {example('explore', 'Coverage', 'Explore')} --robots 40 --steps 400 "
        "--maze examples/maze.png --arena.dump-size 1",
        film(0, 400, per_step=0.1),
    ),
    "failures": Scene(
        f"run {example('failures', 'Failures')} --until 150 --robots 80 --steps 400 {MEDIUM}",
        film(0, 210, per_step=0.15),
    ),
    "two_kinds": Scene(
        f"run {example('two_kinds', 'ByKind')} --strategy beeclust "
        "--robot models/robot.xml:60 {directory}/large.xml:40 --steps 400 "
        "--arena.size 34 --spot-radius 6 --spot-offset 9",
        film(0, 400, per_step=0.1),
    ),
    "learned": Scene("clean --strategy neural --steps 100", film(30, 52, draw=("links",))),
    "walk": Scene(
        f"clean --strategy {{directory}}/walk.py:Walk --robots 60 --steps 120 {SMALL}",
        film(90, 114, draw=("trails",)),
    ),
    "six": Scene(
        f"clean --robot models/robot6.xml --robots 40 {SMALL} --steps 60",
        film(30, 60, draw=("links",)),
    ),
}
"""Runs and what is shown of them."""
TURNABLE = "cleaning"
"""Scene of which there is a replay, on the first page of the documentation."""


@contextmanager
def browser_page(url: str) -> Iterator[BrowserPage]:
    """Open a page in Chromium."""
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=CHROMIUM_FLAGS)
        page = browser.new_page(viewport={"width": WIDTH, "height": HEIGHT})
        page.goto(url)
        try:
            yield page
        finally:
            browser.close()


@contextmanager
def unguarded_server() -> Iterator[viser.ViserServer]:
    """Open a server to which a browser can send its pictures.

    The guard of pages would drop them.
    """
    server = viser.ViserServer(host="127.0.0.1", port=PORT, verbose=False)
    try:
        light(server.scene)
        yield server
    finally:
        close_server(server)


def picture_of(server: viser.ViserServer) -> Image.Image:
    """Return what the first browser of a server shows, without its panel.

    What lies outside of the scene is transparent, so that pictures suit light and dark pages.
    """
    server.flush()
    time.sleep(0.15)  # until the browser has what was sent
    client = next(iter(server.get_clients().values()))
    rendered = client.get_render(HEIGHT, WIDTH, transport_format="png")
    return Image.fromarray(rendered).convert("RGBA")


def pictures_of(server: viser.ViserServer, frames: Iterable[Any]) -> list[Image.Image]:
    """Return a picture of each frame but the first, in which robots are still missing.

    Args:
        server: that shows the frames.
        frames: drawn one by one, as they are iterated over.
    """
    with browser_page(f"http://127.0.0.1:{server.get_port()}"):
        while not server.get_clients():
            time.sleep(0.1)
        time.sleep(3)
        pictures = [picture_of(server) for _ in frames]
    return pictures[1:]


def write(path: Path, pictures: list[Image.Image], max_bytes: int = MAX_BYTES) -> None:
    """Write an animated picture of at most so many bytes, if the lowest quality suffices."""
    first, *further = pictures
    duration_ms = round(1000 / PER_SECOND)
    for quality in (60, 40, 20):
        first.save(
            path,
            save_all=True,
            append_images=further,
            duration=duration_ms,
            loop=0,
            quality=quality,
            method=6,
        )
        if path.stat().st_size < max_bytes:
            break
    print(f"{path}: {path.stat().st_size / 1e6:.2f} MB, {len(pictures)} pictures", flush=True)


def write_files(directory: Path) -> Path:
    """Write the files that commands name into a directory, and return it.

    They are large.xml, a robot that an example makes, and walk.py, a strategy on a page.
    """
    runpy.run_path(str(ROOT / "examples/two_kinds.py"))["write_large"](directory / "large.xml")
    page = (ROOT / "docs/strategies.md").read_text(encoding="utf-8")
    _, _, rest = page.partition("```python\n# walk.py")
    code, _, _ = rest.partition("```")
    (directory / "walk.py").write_text(code, encoding="utf-8")
    return directory


def make_scene(name: str) -> None:
    """Write the picture of a run, and the replay of the one that can be turned."""
    scene = SCENES[name]
    with tempfile.TemporaryDirectory() as directory:
        words = shlex.split(scene.command.format(directory=write_files(Path(directory))))
        out = f"{directory}/run"
        iswarm([*words, "--engine", "planar", "--out", out])
        run = load(out)
        draw, *_ = swarm_film(run, scene.film)
        if name == TURNABLE:
            replay = Film(40, 100, title="280 robots clean the floor")
            write_replay(run, replay, OUT / f"{name}.html")

    with unguarded_server() as server:
        write(OUT / f"{name}.webp", pictures_of(server, draw(server)))


def make_bench() -> None:
    """Write the picture of a ball that is lifted and released."""
    with unguarded_server() as server:
        aim(server.initial_camera, Session(PageScenario(robots=1)).scene, is_low=True)
        bench = Bench(server, Inputs(server, refused=print, failed=print), 139 / 6)
        bench.root.visible = True
        bench.take(bench.settings.trace())

        def frames() -> Iterator[None]:
            for moment in range(0, 100, 2):
                bench.hold(moment)
                yield

        write(OUT / "bench.webp", pictures_of(server, frames()))


def make_page() -> None:
    """Write the picture of the page itself."""
    session = Session(PageScenario())
    page = Page(session, PORT)
    pictures = []
    try:
        with browser_page(page.url) as browser:
            browser.set_viewport_size({"width": 1000, "height": 600})
            time.sleep(4)
            # Close the note on software rendering.
            browser.locator("[class*=mantine-Notification] button").first.click()

            for step in range(1, N_PAGE_STEPS + 1):
                session.post(session.advance)
                while session.step < step or session.shown < step:
                    time.sleep(0.05)
                time.sleep(0.7)
                pictures.append(Image.open(io.BytesIO(browser.screenshot())).convert("RGB"))
    finally:
        page.close()
    write(ROOT / "docs" / "play.webp", pictures, 5 * MAX_BYTES)


def makers() -> dict[str, Callable[[], None]]:
    """Return functions that make the pictures, by name."""
    scenes = {name: lambda name=name: make_scene(name) for name in SCENES}
    return {**scenes, "bench": make_bench, "page": make_page}


def main() -> None:
    """Make the pictures that are named, or all."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    known = makers()
    parser.add_argument("names", nargs="*", metavar="NAME", help=", ".join(known))
    names = parser.parse_args().names
    unknown = set(names) - set(known)
    if unknown:
        parser.error(f"there is no picture {min(unknown)}")
    OUT.mkdir(exist_ok=True)
    for name in names or known:
        known[name]()


if __name__ == "__main__":
    main()
