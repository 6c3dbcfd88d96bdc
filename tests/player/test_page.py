"""The page draws whatever happens: it is on this machine alone, and faults do not end it."""

import time
from urllib.parse import urlsplit

import psutil
import pytest
from support.page import (
    assert_no_error,
    assert_serves,
    draw,
    is_ended,
    select,
    selected_robot,
    send_ray,
    stop_threads,
    wait,
)

from iswarm_mj.output.frames import RecordedWorld
from iswarm_mj.player.bench import BenchSettings
from iswarm_mj.player.page import close_server, open_server
from iswarm_mj.player.view import SwarmView

NAN = float("nan")
INFINITY = float("inf")


def test_pages_listen_to_this_machine_alone_each_on_its_own_port(page):
    second = open_server(8310)  # the same port is free at another address
    try:
        assert second.request_share_url() is None
        connections = psutil.Process().net_connections()
        listening = [each.laddr for each in connections if each.status == psutil.CONN_LISTEN]
        urls = [urlsplit(page.url), urlsplit(second.url)]
        ports = {url.port for url in urls}
        assert {address.ip for address in listening} >= {url.hostname for url in urls}
        assert {address.port for address in listening} >= ports
        addresses = {address.ip for address in listening if address.port in ports}
        assert all(address.startswith("127.") for address in addresses)
    finally:
        close_server(second)


def test_a_notebook_shows_the_page(page):
    assert f'src="{page.url}"' in page._repr_html_()


def test_no_drawing_mixes_two_runs(page, browser, monkeypatch):
    """A reset may take long, and bring fewer robots."""
    session = page.session
    frames = RecordedWorld.frames

    def slow_frames(*arguments):
        time.sleep(0.5)
        return frames(*arguments)

    def begin_again():
        session.set("robots", 12)
        session.reset()

    monkeypatch.setattr(RecordedWorld, "frames", slow_frames)
    session.post(begin_again)
    wait(lambda: session.version > 1 and "12 robots" in browser.text)
    time.sleep(1)  # in which it draws
    assert len(session.is_alive) == 12
    assert_no_error(page)


@pytest.mark.parametrize(
    ("shown", "last_step", "share"),
    [(0.0, 3, 0.5), (1.25, 4, 0.75), (3.0, 4, 1.0)],
)
def test_what_is_drawn_lies_between_two_steps(page, monkeypatch, shown, last_step, share):
    """It goes on by ten steps a second, and is at most three steps behind the latest one.

    Args:
        shown: what was drawn a quarter of a second ago [steps].
        last_step: latest step that the drawing needs.
        share: share of that step.
    """
    stop_threads(page)
    drawn = []

    def note(_, past, share, __):
        drawn.append((past[-1].step[0], share))

    monkeypatch.setattr(SwarmView, "show", note)
    for _ in range(4):
        page.session.advance()
    page.session.shown = shown
    draw(page, elapsed=0.25)
    assert drawn == [(last_step, share)]


def test_faults_of_drawing_and_of_the_bench_leave_the_page_alive(page, browser, monkeypatch, capfd):
    session = page.session
    n_drawings = 0

    def fail(*_):
        nonlocal n_drawings
        n_drawings += 1
        raise ZeroDivisionError("drawn")

    def trace_nothing(_):
        return [][0]

    with monkeypatch.context() as patch:
        patch.setattr(SwarmView, "show", fail)
        wait(lambda: n_drawings > 20)
        patch.setattr(BenchSettings, "trace", trace_nothing)
        browser.press("Lift and release the ball")
        wait(lambda: "The trial failed." in browser.text)
        session.post(session.advance)
        wait(lambda: "**step 1**" in browser.text)

    session.post(session.reset)
    session.post(session.advance)
    wait(lambda: session.version == 2 and session.step == 1)
    assert_serves(page)
    printed = capfd.readouterr().err
    assert printed.count("ZeroDivisionError: drawn") == 1
    assert printed.count("IndexError: list index out of range") == 1


def test_an_interruption_ends_the_page(page):
    def interrupt():
        raise KeyboardInterrupt

    page.session.post(interrupt)
    wait(lambda: is_ended(page))
    with pytest.raises(KeyboardInterrupt):
        page.wait()


@pytest.mark.parametrize(
    ("origin", "direction"),
    [
        ((0, 0, 90), (0, 0, NAN)),
        ((INFINITY, 0, 90), (0, 0, -1)),
        ((1e308, 0, 90), (1e308, 0, -1e-300)),
        ((0, 0), (0, -1)),
        ("abc", "abc"),
        (None, None),
        ((0, 0, 90), (0, 0, "x")),
    ],
)
def test_rays_that_no_browser_sends_hit_nothing(page, origin, direction):
    select(page, 4)
    send_ray(page, origin, direction)
    assert selected_robot(page) == 4
