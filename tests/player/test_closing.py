"""The page closes soon whatever is computed, and completes its recording."""

from threading import Event, Thread

import pytest
from support.rrd import read

from iswarm_mj import SwarmConfig, play
from iswarm_mj.config.swarm import ArenaConfig
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.player import page as player_page
from iswarm_mj.simulation.scenario import Scenario

SECONDS = 120
CONFIG = SwarmConfig(ArenaConfig(size=24.0, n_dust=12, dust_area_offset=7.0))


@pytest.fixture
def played():
    played = play(Scenario(CONFIG, robots=20, engine=PlanarSettings(), seed=3), port=8360)
    yield played
    played.close()


@pytest.fixture
def compiler(played, monkeypatch):
    """What takes long inside of a control step, from `began` on until `ends`."""
    compiler = type("Compiler", (), {"began": Event(), "ends": Event()})
    run = played.session.run
    advance = run.advance

    def compile_and_advance():
        compiler.began.set()
        assert compiler.ends.wait(SECONDS)
        return advance()

    monkeypatch.setattr(run, "advance", compile_and_advance)
    monkeypatch.setattr(player_page, "CLOSE_S", 0.2)
    yield compiler
    compiler.ends.set()


def close(played):
    """Close the page, in a thread of its own so that the test ends where it does not."""
    closing = Thread(target=played.close, daemon=True)
    closing.start()
    closing.join(SECONDS / 2)
    assert not closing.is_alive()


def test_it_does_not_wait_for_a_compiler(played, compiler):
    played.session.post(played.session.advance)
    assert compiler.began.wait(SECONDS)
    close(played)
    assert played._threads[0].is_alive()
    assert not played._server.get_clients()

    compiler.ends.set()
    played._threads[0].join(SECONDS)
    assert not played._threads[0].is_alive()
    assert played._error is None


def test_a_recording_is_complete_though_a_step_is_still_computed(
    played, compiler, tmp_path, monkeypatch
):
    session = played.session
    monkeypatch.setattr(session, "_out", tmp_path)
    session.post(session.start_recording)
    session.post(session.advance)
    assert compiler.began.wait(SECONDS)
    close(played)

    # The step that ends later is not in it, and disturbs nothing.
    compiler.ends.set()
    played._threads[0].join(SECONDS)
    assert played._error is None and session.step == 1
    (path,) = tmp_path.iterdir()
    assert read(path)["/world/robots/body"]["step"] == [0]
