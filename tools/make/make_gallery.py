"""Make the moving pictures of the documentation from seeds: docs/replays/, and docs/play.webp of
the page itself.

`python tools/make/make_gallery.py [NAME ...]` runs each scene and writes what it looks like as an
animated picture; of the first also a replay that can be turned. Needs Debian's chromium, and `pip
install playwright`.
"""

import io
import runpy
import shlex
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import viser
from PIL import Image
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
write_large = runpy.run_path(str(ROOT / "examples/two_kinds.py"))["write_large"]
OUT = ROOT / "docs" / "replays"
WIDTH, HEIGHT, PER_SECOND, LARGEST = 640, 480, 8, 300_000
FLAGS = [
    "--no-sandbox",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-dev-shm-usage",
]


class Card(NamedTuple):
    command: str
    film: Film


def own(file: str, task: str, strategy: str = "") -> str:
    """Flags of an example."""
    return (
        f"--task examples/{file}.py:{task}"
        + f" --strategy examples/{file}.py:{strategy}" * bool(strategy)
    )


def film(
    first: int,
    last: int,
    each: float = 1.0,
    by: str = STATE,
    draws: tuple[str, ...] = (),
    title: str = "",
) -> Film:
    """Eight pictures a second, of which there are `each` to a control step."""
    return Film(first, last, PER_SECOND / each, each, by, draws, title)


SMALL = "--arena.size 24 --arena.dust-area-offset 7 --arena.dust-area-size 5 --arena.n-dust 36"
TWO_SIZES = "--arena.size 30 --arena.ball-radius-min 12e-6 --arena.ball-radius-max 28e-6"
BOXES = "--arena.size 30 --arena.boxes 0 6 1 1 0 1e-5 0.004 -4 -4 0.8 1.5 10 1e-5 0.004 5 -8 0.8 0.8 0 8e-6 0.004"
MEDIUM = "--arena.size 30 --arena.dust-area-offset 9"
CARDS = {
    "cleaning": Card("clean --steps 100", film(60, 80, draws=("links",))),
    "hops": Card(
        "clean --genome type2 --steps 100", film(60, 82, by="hops to dump", draws=("links",))
    ),
    "foraging": Card(
        "run --task foraging --strategy forager --robots 60 --steps 150",
        film(110, 140, draws=("trails", "home")),
    ),
    "aggregation": Card(
        "run --task aggregation --strategy beeclust --robots 120 --steps 410", film(0, 400, 0.1)
    ),
    "contest": Card(
        f"run {own('contest', 'Contest')} --strategy forager=0.5 type1=0.5 --robots 120 --steps 240",
        film(200, 230),
    ),
    "sort": Card(
        f"run {own('sort', 'Sort', 'BySize')} --robots 80 --steps 200 {TWO_SIZES}",
        film(0, 160, 0.25),
    ),
    "clusters": Card(
        f"run {own('clusters', 'Clusters', 'Cluster')} --steps 3000", film(0, 3000, 0.01)
    ),
    "boxes": Card(
        f"run {own('boxes', 'Push', 'Sweep')} --robots 120 --steps 400 --seed 1 {BOXES}",
        film(0, 320, 0.1),
    ),
    "explore": Card(
        f"run {own('explore', 'Coverage', 'Explore')} --robots 40 --steps 400 "
        "--maze examples/maze.png --arena.dump-size 1",
        film(0, 400, 0.1),
    ),
    "failures": Card(
        f"run {own('failures', 'Failures')} --until 150 --robots 80 --steps 400 {MEDIUM}",
        film(0, 210, 0.15),
    ),
    "two_kinds": Card(
        f"run {own('two_kinds', 'ByKind')} --strategy beeclust --robot models/robot.xml:60 large.xml:40 --steps 400 "
        "--arena.size 34 --spot-radius 6 --spot-offset 9",
        film(0, 400, 0.1),
    ),
    "six": Card(
        f"clean --robot models/robot6.xml --robots 40 {SMALL} --steps 60",
        film(30, 60, draws=("links",)),
    ),
}
"""Runs and what is shown of them; the first can be turned, on the first page."""
BENCH, PAGE = "bench", "page"


def images(url: str) -> Iterator[Any]:
    """A page in Chromium."""
    with sync_playwright() as play:
        browser = play.chromium.launch(executable_path="/usr/bin/chromium", args=FLAGS)
        page = browser.new_page(viewport={"width": WIDTH, "height": HEIGHT})
        page.goto(url)
        yield page
        browser.close()


def open_unguarded() -> Any:
    """Return a server to which a browser can send its pictures, which the guard of pages would
    drop."""
    return viser.ViserServer(host="127.0.0.1", port=8400, verbose=False)


def rendered(server: Any) -> Image.Image:
    """What the first browser of a server shows, without its panel."""
    server.flush()
    time.sleep(0.15)  # until it has what was sent
    client = next(iter(server.get_clients().values()))
    shown = Image.fromarray(client.get_render(HEIGHT, WIDTH, transport_format="png"))
    paper = Image.new("RGBA", shown.size, "white")
    paper.alpha_composite(shown.convert("RGBA"))
    return paper.convert("RGB")


def scenes(server: Any, draw: Any) -> list[Image.Image]:
    found = []
    for _ in images(f"http://127.0.0.1:{server.get_port()}"):
        while not server.get_clients():
            time.sleep(0.1)
        time.sleep(3)
        _, *found = [
            rendered(server) for _ in draw(server)
        ]  # in the first one robots are still missing
    return found


def write(path: Path, pictures: list[Image.Image], largest: int = LARGEST) -> None:
    """Write an animated picture of at most so many bytes, if the lowest quality suffices."""
    first, *rest = pictures
    more = {
        "save_all": True,
        "append_images": rest,
        "duration": round(1000 / PER_SECOND),
        "loop": 0,
    }
    for quality in (60, 40, 20):
        first.save(path, quality=quality, method=6, **more)
        if path.stat().st_size < largest:
            break
    print(f"{path}: {path.stat().st_size / 1e6:.2f} MB, {len(pictures)} pictures", flush=True)


def swarm(name: str) -> None:
    card = CARDS[name]
    with tempfile.TemporaryDirectory() as place:
        large = Path(place, "large.xml")
        write_large(large)
        words = shlex.split(card.command.replace(large.name, str(large)))
        iswarm([*words, "--engine", "planar", "--out", f"{place}/run"])
        run = load(f"{place}/run")
        draw, *_ = swarm_film(run, card.film)
        if name == next(iter(CARDS)):
            write_replay(
                run, Film(40, 100, title="280 robots clean the floor"), OUT / f"{name}.html"
            )
    server = open_unguarded()
    try:
        light(server.scene)
        write(OUT / f"{name}.webp", scenes(server, draw))
    finally:
        close_server(server)


def bench() -> None:
    """A ball that is lifted and released."""
    server = open_unguarded()
    try:
        light(server.scene)
        aim(server.initial_camera, Session(PageScenario(robots=1)).scene, is_low=True)
        shown = Bench(server, Inputs(server, refused=print, failed=print), 139 / 6)
        shown.root.visible = True
        shown.take(shown.settings.trace())

        def draw(_: Any) -> Iterator[float]:
            for moment in range(0, 100, 2):
                shown.hold(moment)
                yield 0.1

        write(OUT / f"{BENCH}.webp", scenes(server, draw))
    finally:
        close_server(server)


def page() -> None:
    """The page itself."""
    session = Session(PageScenario())
    shown = Page(session, 8400)
    pictures = []
    try:
        for browser in images(shown.url):
            browser.set_viewport_size({"width": 1000, "height": 600})
            time.sleep(4)
            browser.locator(
                "[class*=mantine-Notification] button"
            ).first.click()  # software rendering
            for k in range(36):
                session.post(session.advance)
                while session.step < k + 1 or session.shown < k + 1:
                    time.sleep(0.05)
                time.sleep(0.7)
                pictures.append(Image.open(io.BytesIO(browser.screenshot())).convert("RGB"))
    finally:
        shown.close()
    write(ROOT / "docs" / "play.webp", pictures, 5 * LARGEST)


if __name__ == "__main__":
    OUT.mkdir(exist_ok=True)
    for wanted in sys.argv[1:] or [*CARDS, BENCH, PAGE]:
        {BENCH: bench, PAGE: page}.get(wanted, lambda wanted=wanted: swarm(wanted))()
