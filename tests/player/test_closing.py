"""The page closes soon, even while something is computed, and completes its recording."""

from threading import Event, Thread

import pytest
from support.page import assert_no_error, clients, opened, session_thread
from support.rrd import read

from iswarm_mj.player import page as player_page

SECONDS = 120
"""Time after which a test that waits has failed [s]."""


@pytest.fixture
def page(tmp_path):
    """A page that records to `tmp_path`."""
    with opened(port=8360, out=tmp_path) as page:
        yield page


class Compiler:
    """Something inside of a control step that takes until a test ends it.

    Attributes:
        has_begun: set once the step has begun.
        may_end: set when the step may end.
    """

    def __init__(self):
        self.has_begun = Event()
        self.may_end = Event()

    def work(self):
        """Work until the test lets it end."""
        self.has_begun.set()
        assert self.may_end.wait(SECONDS)


@pytest.fixture
def compiler(page, monkeypatch):
    """Something that takes long inside of the page's control steps."""
    compiler = Compiler()
    run = page.session.run
    advance = run.advance

    def compile_and_advance():
        compiler.work()
        return advance()

    monkeypatch.setattr(run, "advance", compile_and_advance)
    monkeypatch.setattr(player_page, "CLOSE_S", 0.2)
    yield compiler
    compiler.may_end.set()


def close(page):
    """Close a page, in a thread of its own, so that the test ends where that does not."""
    closing = Thread(target=page.close, daemon=True)
    closing.start()
    closing.join(SECONDS / 2)
    assert not closing.is_alive()


def finish(page, compiler):
    """Let the compiler end, and wait for the thread of a closed page."""
    compiler.may_end.set()
    session_thread(page).join(SECONDS)
    assert not session_thread(page).is_alive()
    assert_no_error(page)


def test_it_does_not_wait_for_a_compiler(page, compiler):
    page.session.post(page.session.advance)
    assert compiler.has_begun.wait(SECONDS)
    close(page)
    assert session_thread(page).is_alive()
    assert not clients(page)
    finish(page, compiler)


def test_a_recording_is_complete_though_a_step_is_still_computed(page, compiler, tmp_path):
    session = page.session
    session.post(session.start_recording)
    session.post(session.advance)
    assert compiler.has_begun.wait(SECONDS)
    close(page)

    # The step that ends later is not in it, and disturbs nothing.
    finish(page, compiler)
    assert session.step == 1
    (path,) = tmp_path.iterdir()
    assert read(path)["/world/robots/body"]["step"] == [0]
