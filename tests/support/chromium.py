"""Chromium that draws without a graphics card, driven by Playwright."""

import shutil
from contextlib import contextmanager

import numpy as np
import pytest
from viser.transforms import SO3

FLAGS = [
    "--no-sandbox",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-dev-shm-usage",
]
"""Flags of a Chromium that draws without a graphics card."""
SECONDS = 120
"""Time after which a test that waits has failed [s]."""
WIDTH = 1280
HEIGHT = 900
"""Size of the window [pixels]."""


@contextmanager
def started_chromium():
    """Start Chromium without a window on the screen, and end it after the block."""
    sync_api = pytest.importorskip("playwright.sync_api")
    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=FLAGS)
        yield browser
        browser.close()


def open_tab(browser, url, **settings):
    """Open a page in a tab that waits long enough for slow machines; close viser's notice.

    Args:
        browser: browser of `started_chromium`.
        url: address of the page.
        settings: settings of the tab, such as `color_scheme`.
    """
    tab = browser.new_page(viewport={"width": WIDTH, "height": HEIGHT}, **settings)
    tab.set_default_timeout(SECONDS * 1000)
    tab.goto(url)
    tab.locator("[class*=mantine-Notification] button").first.click()  # of software rendering
    return tab


def pixel_of(camera, point):
    """Return the pixel x, y at which a camera of viser sees a point [mm]."""
    right, down, ahead = SO3(camera.wxyz).inverse() @ (point - camera.position)
    focal_length = camera.image_height / 2 / np.tan(camera.fov / 2)
    x = camera.image_width / 2 + focal_length * right / ahead
    y = camera.image_height / 2 + focal_length * down / ahead
    return x, y
