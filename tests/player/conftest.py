"""Pages without a window, with and without threads of their own."""

from dataclasses import replace

import pytest
from support.page import SCENARIO, Browser, opened, stop_threads

from iswarm_mj.player.page import close_server, open_server

PORT = 8310
"""First port that is tried; pages in other files of tests have others."""


@pytest.fixture
def page():
    """A page of 20 robots that do not move yet."""
    with opened(port=PORT) as page:
        yield page


@pytest.fixture
def browser(page):
    """A browser that shows `page`."""
    return Browser(page)


@pytest.fixture
def recordings(tmp_path):
    """Directory of the recordings of `still`, which is not there at first."""
    return tmp_path / "page" / "recordings"


@pytest.fixture
def new(recordings):
    """A page of 10 robots before their first step, and its browser; tests do its threads' work."""
    scenario = replace(SCENARIO, robots=10)
    with opened(scenario, port=PORT + 20, out=recordings) as page:
        stop_threads(page)
        yield page, Browser(page)


@pytest.fixture
def still(new):
    """A page of 10 robots that have taken a step, and its browser; tests do its threads' work."""
    page, browser = new
    page.session.advance()
    return page, browser


@pytest.fixture
def server():
    """A server without a page."""
    server = open_server(PORT + 40)
    yield server
    close_server(server)


@pytest.fixture
def second_server(server):
    """Another server, on the same port of its own address."""
    second = open_server(server.get_port())
    yield second
    close_server(second)
