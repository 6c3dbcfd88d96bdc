"""The page without a browser: where it listens, what it draws, what a click does; replays; the
bench."""

import base64
import itertools
import re
import time
from dataclasses import replace
from pathlib import Path
from threading import Event
from types import SimpleNamespace
from urllib.parse import urlsplit

import msgspec
import numpy as np
import psutil
import pytest
import zstandard
from support.cli import code_of

from iswarm_mj import SwarmConfig, play
from iswarm_mj.config.swarm import ArenaConfig
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.gripper.bench.force_curve import force_curve
from iswarm_mj.gripper.bench.protocol import Protocol
from iswarm_mj.gripper.laws.adhesion import dmt_pull_off
from iswarm_mj.gripper.laws.detachment import WORK_TOOL_OBJECT, release_voltage
from iswarm_mj.gripper.laws.materials import MATERIALS
from iswarm_mj.output.frames import RecordedWorld
from iswarm_mj.output.loading import load, scene_of
from iswarm_mj.output.palette import GREEN, ORANGE, rgb
from iswarm_mj.output.trial_shapes import trial_shapes
from iswarm_mj.player import replay
from iswarm_mj.player.bench import BenchSettings, outcome
from iswarm_mj.player.film import Film
from iswarm_mj.player.page import close_server, open_server
from iswarm_mj.player.panel import BUILD, DROP, LIFE, REMOVE
from iswarm_mj.player.replay import swarm_film, write_replay
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.scenario import Scenario
from iswarm_mj.utils.errors import UserError
from iswarm_mj.workflows.clean import run_swarm

SECONDS = 120
CONFIG = SwarmConfig(ArenaConfig(size=24.0, n_dust=12, dust_area_offset=7.0))


def wait(holds):
    end = time.monotonic() + SECONDS
    while not holds():
        assert time.monotonic() < end
        time.sleep(0.1)


@pytest.fixture
def played():
    played = play(Scenario(CONFIG, robots=20, engine=PlanarSettings(), seed=3), port=8310)
    yield played
    played.close()


def test_pages_listen_to_this_machine_alone_each_on_its_own_port(played):
    other = open_server(8310)  # the same port is free at another address
    try:
        assert other.request_share_url() is None
        found = {
            c.laddr for c in psutil.Process().net_connections() if c.status == psutil.CONN_LISTEN
        }
        ports = {urlsplit(played.url).port, other.get_port()}
        hosts = {urlsplit(played.url).hostname, urlsplit(other.url).hostname}
        assert {address.ip for address in found} >= hosts and {
            address.port for address in found
        } >= ports
        assert all(address.ip.startswith("127.") for address in found if address.port in ports)
    finally:
        close_server(other)
    assert played.url in played._repr_html_()


def test_resets_while_it_draws(played, monkeypatch):
    """However long a reset takes, no drawing mixes both runs, of which one has fewer robots."""
    session, frames = played.session, RecordedWorld.frames
    monkeypatch.setattr(
        RecordedWorld, "frames", lambda *given: (time.sleep(0.5), frames(*given))[1]
    )
    session.post(lambda: (session.set("robots", 12), session.reset()))
    wait(lambda: session.version > 1 and played._drawn_version == session.version)
    time.sleep(1)
    assert played._error is None and len(session.is_alive) == 12


def test_clicks_select_kill_and_drop(played):
    session, panel = played.session, played._panel
    session.advance()
    x, y = session.snapshots[-1].frames.pose[0, 5, :2] * 1e3
    way = np.array([0.1, 0.6, -0.8])  # to half the height of robot 5
    played._clicked(
        SimpleNamespace(ray_origin=np.array([x + 0.1, y, 0.5]) - 90 * way, ray_direction=2 * way)
    )
    assert panel.view.selected == 5
    panel.update()
    assert "20 robots · cleaning, type1" in panel._status.content
    assert "**Robot 5**" in panel._robot.content and "| remembers |" in panel._robot.content
    panel.click = LIFE
    panel.clicked(x, y, 1.6)
    panel.click = DROP
    panel.clicked(0.0, 20.0, 1.6)
    panel.click = REMOVE
    panel.clicked(x, y, 1.6)
    panel.clicked(x, y, 1.6)
    panel.click = BUILD
    for place in (
        (20.0, -20.0),
        (-20.0, -20.0),
        (-20.5, -19.5),
    ):  # the third one takes the second away
        panel.clicked(*place, 1.6)
    ended = Event()
    session.post(ended.set)
    assert ended.wait(60)  # the page's own thread works
    assert [change.what for change in session.changes] == ["kill", "ball"]
    assert not session.is_alive[5] and session.run.settings.n_robots == 20
    panel.update()
    assert "**Reset** applies: robots, obstacles." in panel._status.content
    assert session.wanted.n_robots == 18 and session.wanted.config.arena.obstacles == (
        (7.07, -7.07, 1.0, 1.0, 0.0),
    )


def test_what_is_drawn_lies_between_two_steps(played, monkeypatch):
    """A quarter of a second at ten steps a second, but at most three steps behind the latest."""
    played._stop.set()
    for thread in played._threads:
        thread.join()
    session, shown = played.session, []
    monkeypatch.setattr(
        played._panel.view, "show", lambda past, share, _: shown.append((past[-1].step[0], share))
    )
    for _ in range(4):
        session.advance()
    for begin in (0.0, 1.25, 3.0):
        session.shown = begin
        played._draw(0.0, 0.25)
    assert shown == [(3, 0.5), (4, 0.75), (4, 1.0)]


def test_the_bench_draws_the_curve_of_its_sliders_and_a_trial(played):
    bench = played._panel.bench
    before = bench._curve.data
    bench._move("relative_humidity", 50.0)
    wait(lambda: bench._curve.data is not before)
    np.testing.assert_array_equal(bench._curve.data, BenchSettings(relative_humidity=50.0).curve())
    works = [bench._handles["work_object_substrate"].value]
    bench._move("plate_material", "silica")
    works.append(bench._handles["work_object_substrate"].value)
    assert works[1] == pytest.approx(works[0] * (0.26 / 2.42) ** 0.5)
    bench._move("plate_material", "steel")
    bench._due.add("trial")
    wait(lambda: bench.trace is not None)
    assert bench.trace.voltage.max() >= 40
    bench.hold(60.0)
    where, sample = trial_shapes(bench.trace), int(0.6 * len(bench.trace.time))
    for node, part in (
        (bench._ball, where.ball),
        (bench._mark, where.mark),
        (bench._probe, where.probe),
    ):
        np.testing.assert_allclose(node.position, bench._scale * part[sample], rtol=1e-6)
    assert tuple(bench._ball.color) == rgb(
        ORANGE if bench.trace.on_plate_potential[sample] else GREEN
    )


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    out = tmp_path_factory.mktemp("run")
    run_swarm(Run(Scenario(CONFIG, robots=20, engine=PlanarSettings(), seed=3, steps=12)), out)
    return load(out)


def test_a_replay_is_one_file_with_the_run_in_it(run, tmp_path):
    write_replay(run, Film(2, 10, speed=4.0, title="A <b> & c"), tmp_path / "page.html")
    text = (tmp_path / "page.html").read_text()
    assert "<title>A &lt;b&gt; &amp; c</title>" in text
    assert not re.findall(r"""(?:src|href)=["']?(?:https?:)?//""", text)
    data = base64.b64decode(re.search(r'__VISER_EMBED_DATA__="([^"]+)"', text)[1])
    inner = zstandard.ZstdDecompressor().decompress(
        data[8:], max_output_size=int.from_bytes(data[:8], "little")
    )
    size = int.from_bytes(inner[:8], "little")
    content = msgspec.msgpack.decode(inner[8 : 8 + size])
    assert content["durationSeconds"] == pytest.approx((8 * 2 + 1) / 8)
    lengths = content["binaryBufferLengths"]
    starts = np.append(0, np.cumsum([-(-length // 8) * 8 for length in lengths]))
    buffers = [inner[-int(starts[-1]) :][s : s + n] for s, n in zip(starts, lengths, strict=False)]
    poses = {np.frombuffer(b, np.float32).tobytes() for b in buffers if len(b) == 20 * 12}
    expected = np.column_stack([run.arrays["pose"][10, :, :2] * 1e3, np.full(20, 0.5)])
    found = [np.frombuffer(one, np.float32).reshape(20, 3) for one in poses]
    assert min(np.abs(one - expected).max() for one in found) <= 1 / 128 + 1e-4


def test_the_last_step_of_a_replay_is_that_of_the_run_or_some_after_the_first(
    run, tmp_path, monkeypatch, capsys
):
    assert swarm_film(run, Film(2))[2] == 12
    monkeypatch.setattr(replay, "MOST_STEPS", 3)
    assert swarm_film(run, Film(2))[2] == 5
    command = ("replay", str(run.path), f"--out={tmp_path / 'replay.html'}")
    assert code_of(*command) == code_of(*command, "--last=4") == code_of(*command, "--first=9") == 0
    cut, chosen, whole = capsys.readouterr().out.splitlines()
    assert (
        "steps 0 to 3 of" in cut
        and cut.endswith("--last 12 shows all")
        and "shows all" not in chosen
    )
    assert "steps 9 to 12 of" in whole and "shows all" not in whole


@pytest.mark.parametrize(
    "film", [Film(0, 99), Film(5, 5), Film(colour_by="red"), Film(draw=("links", "foo"))]
)
def test_impossible_replays(run, film, tmp_path):
    with pytest.raises(UserError):
        write_replay(run, film, tmp_path / "page.html")
    assert not list(Path(tmp_path).iterdir())


@pytest.mark.parametrize(
    "changed",
    [
        {"link_sender": lambda a: a + 30},
        {"dust_hop": lambda a: a.astype("U3")},
        {"scene_area_shapes": lambda a: np.array(["disc"])},
    ],
)
def test_a_replay_of_arrays_that_do_not_fit(run, changed, tmp_path):
    arrays = run.arrays | {name: change(run.arrays[name]) for name, change in changed.items()}
    odd = replace(run, scenes={0: scene_of(arrays)}, _arrays={0: arrays})
    with pytest.raises(UserError, match="the recorded arrays do not fit each other"):
        write_replay(odd, Film(2, 10), tmp_path / "page.html")
    assert not list(tmp_path.iterdir())


def test_all_materials_can_touch():
    """Works of adhesion follow from the materials; the weakest pair's trial is that of its law."""
    weakest = BenchSettings()
    for ball, tool, plate in itertools.product(MATERIALS, repeat=3):
        settings = BenchSettings()
        for part, material in (("ball", ball), ("tool", tool), ("plate", plate)):
            settings = settings.changed(f"{part}_material", material)
        if settings.work_tool_object < weakest.work_tool_object:
            weakest = settings
    assert weakest.ball_material == weakest.tool_material == "polystyrene"
    _, _, back = replace(weakest, voltage=0.0).curve()
    pull_off = 1e9 * dmt_pull_off(15e-6, 1e-3 * weakest.work_tool_object)
    assert -back.min() == pytest.approx(pull_off, rel=1e-6)


def test_materials_that_contradict_each_other_leave_the_controls_as_they_were(played, monkeypatch):
    bench = played._panel.bench

    def refuse(*_):
        raise UserError("refused")

    bench._handles["tool_material"].value = "polystyrene"
    monkeypatch.setattr(BenchSettings, "changed", refuse)
    with pytest.raises(UserError, match="refused"):
        bench._move("tool_material", "polystyrene")
    assert bench._handles["tool_material"].value == "aluminium" == bench.settings.tool_material


def test_faults_of_drawing_and_of_the_bench_leave_the_page_alive(played, monkeypatch, capfd):
    session, panel = played.session, played._panel
    steps = [0]

    def fail(*_):
        steps[0] += 1
        raise ZeroDivisionError("drawn")

    with monkeypatch.context() as patch:
        patch.setattr(panel.view, "show", fail)
        wait(lambda: steps[0] > 20)
        patch.setattr(BenchSettings, "trace", lambda _: [][0])
        panel.bench._due.add("trial")
        wait(lambda: panel.bench._text.content == "The trial failed.")
        session.post(session.advance)
        wait(lambda: "**step 1**" in panel._status.content)
    session.post(session.reset)
    session.post(session.advance)
    wait(lambda: session.version == 2 and session.step == 1)
    assert played._error is None and all(thread.is_alive() for thread in played._threads)
    printed = capfd.readouterr().err
    assert (
        printed.count("ZeroDivisionError: drawn")
        == printed.count("IndexError: list index out of range")
        == 1
    )


def test_an_interruption_ends_the_page(played):
    def interrupt():
        raise KeyboardInterrupt

    played.session.post(interrupt)
    wait(played._stop.is_set)
    with pytest.raises(KeyboardInterrupt):
        played.wait()


@pytest.mark.parametrize(
    ("origin", "way"),
    [
        ((0, 0, 90), (0, 0, float("nan"))),
        ((float("inf"), 0, 90), (0, 0, -1)),
        ((1e308, 0, 90), (1e308, 0, -1e-300)),
        ((0, 0), (0, -1)),
        ("abc", "abc"),
        (None, None),
        ((0, 0, 90), (0, 0, "x")),
    ],
)
def test_rays_that_no_browser_sends_hit_nothing(played, origin, way):
    played._panel.view.selected = 4
    played._clicked(SimpleNamespace(ray_origin=origin, ray_direction=way))
    assert played._panel.view.selected == 4


def test_what_no_command_repeats_is_said(played, monkeypatch):
    panel = played._panel

    def refuse():
        raise UserError("no flag can state the teams")

    monkeypatch.setattr(played.session, "command", refuse)
    wait(lambda: "no flag can state the teams" in panel._repeats.content)
    assert not panel._command.content


def test_the_force_curve_follows_voltage_and_humidity():
    def pull_off(**settings):
        return -BenchSettings(**settings).curve()[2].min()

    assert pull_off(voltage=0) < pull_off(voltage=20)
    assert pull_off(voltage=20) < pull_off(voltage=20, relative_humidity=50)
    height, there, back = BenchSettings(voltage=0).curve()
    assert (np.diff(height) > 0).all() and np.isfinite([there, back]).all()
    assert there.max() > 100 > -100 > back.min()  # pressed, then pulled off
    assert max(abs(there[-1]), abs(back[-1])) < 1  # of no voltage far away
    for row in force_curve(BenchSettings(voltage=0).trial, Protocol(), 0.0)[::40]:
        side = there if row["direction"] == "approach" else back
        assert np.interp(1e6 * row["tip"], height, side) == pytest.approx(
            1e9 * row["total"], abs=1e-6
        )


def test_the_outcome_of_a_trial():
    assert "stays on the plate" in outcome(BenchSettings(voltage=5).trace())
    lifted = outcome(BenchSettings(voltage=45, gap=9).trace())
    volts = float(re.search(r"let go at (\d+) V", lifted)[1])
    assert volts == pytest.approx(
        release_voltage(15e-6, WORK_TOOL_OBJECT, 9e-6), rel=0.08
    )  # the charge follows
    with pytest.raises(UserError):
        BenchSettings(radius=500)
