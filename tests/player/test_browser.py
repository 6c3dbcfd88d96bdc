"""The page in Chromium: it loads, the swarm moves, pause stops it, a slider changes a rule, a command is shown."""

import shutil
import time

import pytest

from iswarm_mj import SwarmConfig, play
from iswarm_mj.config import ArenaConfig
from iswarm_mj.engines.planar.settings import PlanarSettings

CHROMIUM = shutil.which("chromium")
FLAGS = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--disable-dev-shm-usage"]
SECONDS = 120


def wait(holds):
    end = time.monotonic() + SECONDS
    while not holds():
        assert time.monotonic() < end
        time.sleep(0.2)


@pytest.mark.slow
@pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")
def test_play_pause_change_and_copy():
    sync_api = pytest.importorskip("playwright.sync_api")
    config = SwarmConfig(ArenaConfig(size=24.0, n_dust=12, dust_area_offset=7.0))
    played = play(config, robots=20, seed=3, engine=PlanarSettings(), port=8320)
    session = played.session
    try:
        with sync_api.sync_playwright() as started:
            browser = started.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
            pages = [browser.new_page(viewport={"width": 1280, "height": 800}) for _ in range(2)]
            for page in pages:
                page.set_default_timeout(SECONDS * 1000)
                page.goto(played.url)
            pages[0].get_by_role("button", name="Play").click()
            wait(lambda: session.step > 3)
            pages[1].get_by_role("button", name="Pause").click()  # the other one shows the same
            wait(lambda: not session.is_playing)
            step = session.step
            time.sleep(1)
            assert session.step == step
            pages[0].get_by_role("tab", name="Rules").click()
            beside = "//*[text()='p vector forget']/following::input[@inputmode][1]"
            number = pages[0].locator(f"xpath={beside}")
            number.fill("0.75")
            number.press("Enter")
            wait(lambda: session.now.genome.p_vector_forget == 0.75)
            pages[0].get_by_role("tab", name="Share").click()
            wait(lambda: f"--changes {step}:p_vector_forget=0.75" in pages[0].locator("pre").inner_text())
            browser.close()
    finally:
        played.close()
