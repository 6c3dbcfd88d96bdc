"""A viewer that shows a run live: on this machine only, refused where there is none, and closed at any time."""

import re
import socket
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import pytest
import rerun_cli
from helpers_swarm_recording import make_frames, make_scene
from rerun.experimental import ViewerClient

from iswarm_mj.commands.clean import Clean
from iswarm_mj.commands.main import main
from iswarm_mj.output.rerun_live import LiveRecording
from iswarm_mj.output.viewer import open_viewer
from iswarm_mj.utils.errors import UserError

SMALL = "clean --engine planar --impl numba --arena.size 15 --arena.dump-size 3 --arena.dust-area-size 3 "
SMALL += "--arena.dust-area-offset 5 --arena.n-dust 24 --robots 20 --steps 12"


@pytest.fixture(scope="module")
def viewer():
    """Address and process of a viewer without a window."""
    try:
        url, process = open_viewer(headless=True)
    except UserError as error:
        pytest.skip(f"{error}")  # it draws by Vulkan
    yield url, process
    process.kill()
    process.wait()


def shown(url):
    """Recordings that a viewer has, the newest last: name of the application and last step."""
    time.sleep(1.0)
    found = [
        (r.store_id, {line.name: line.end for line in r.timelines})
        for r in ViewerClient.connect(url).get_state().recordings
    ]
    return [(name.split(":")[1], ends["step"]) for name, ends in found]


@pytest.mark.skipif(sys.platform != "linux", reason="others always have a display")
def test_without_a_display_it_is_refused(monkeypatch):
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET"):
        monkeypatch.delenv(name, raising=False)
    with pytest.raises(UserError, match=r"^no viewer can be shown here \(.*DISPLAY.*\); leave out --live"):
        open_viewer()


def test_where_recordings_are_disabled_it_is_refused(monkeypatch):
    monkeypatch.setenv("RERUN", "0")
    with pytest.raises(UserError, match="RERUN=0"):
        open_viewer()


PANIC = """
thread 'main' panicked at 'Failed to create render state: "No graphics adapter was found"'
egui_kittest-0.37.0/src/wgpu.rs:77
stack backtrace:
   6: core::panicking::panic_fmt

Troubleshooting Rerun: https://www.rerun.io/docs/overview/installing-rerun/troubleshooting
Report bugs: https://github.com/rerun-io/rerun/issues
"""


@pytest.mark.parametrize(
    ("said", "reason"),
    [
        ("Error: main.rs:765: no adapter.", "no adapter"),
        (PANIC, 'Failed to create render state: "No graphics adapter was found"'),
        ("", "it ended without a word"),
    ],
)
def test_one_that_ends_after_its_first_answer_is_refused(tmp_path, monkeypatch, said, reason):
    """As without drivers to draw by: it would never answer again."""
    program = tmp_path / "rerun"
    program.write_text(f"#!/bin/sh\nsleep 0.5\ncat >&2 <<'END'\n{said}\nEND\nexit 1\n")
    program.chmod(0o755)
    monkeypatch.setattr(rerun_cli, "__file__", str(program.with_name("__init__.py")))
    monkeypatch.setattr(ViewerClient, "connect", staticmethod(lambda url: SimpleNamespace(get_state=lambda: None)))
    with pytest.raises(UserError, match=rf"^no viewer can be shown here \({re.escape(reason)}\)"):
        open_viewer()


def test_a_run_goes_on_where_no_viewer_answers(capsys):
    with socket.socket() as found:
        found.bind(("127.0.0.1", 0))
        port = found.getsockname()[1]
    scene = make_scene(5, 2)
    with LiveRecording(f"rerun+http://127.0.0.1:{port}/proxy", scene, {}, {}) as recording:
        recording.append(make_frames(scene, 4))
    assert capsys.readouterr().err.count("the viewer was closed") == 1


def test_a_refusal_leaves_the_files_of_an_earlier_run(tmp_path, monkeypatch, capsys):
    def refuse():
        raise UserError("no viewer")

    monkeypatch.setattr(Clean, "_viewer", staticmethod(refuse))
    (tmp_path / "result.json").write_text("old")
    with pytest.raises(SystemExit) as caught:
        main([*SMALL.split(), "--live", "--out", str(tmp_path)])
    assert caught.value.code == 2 and "no viewer" in capsys.readouterr().err
    assert (tmp_path / "result.json").read_text() == "old"


def test_it_has_no_effect_without_a_recording(tmp_path, capsys):
    with pytest.raises(SystemExit) as caught:
        main([*SMALL.split(), "--live", "--no-record", "--out", str(tmp_path)])
    assert caught.value.code == 2 and "--live has no effect" in capsys.readouterr().err


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_it_listens_to_this_machine_alone(viewer):
    url, _ = viewer
    port = f"{int(url.split(':')[2].split('/')[0]):04X}"
    sockets = [
        line.split() for name in ("tcp", "tcp6") for line in Path(f"/proc/net/{name}").read_text().splitlines()[1:]
    ]
    listening = {
        columns[1].split(":")[0] for columns in sockets if columns[3] == "0A" and columns[1].endswith(f":{port}")
    }
    assert listening == {"0100007F"}


def test_a_run_is_shown_to_its_end(viewer, tmp_path, monkeypatch):
    monkeypatch.setattr(Clean, "_viewer", staticmethod(lambda: viewer[0]))
    main([*SMALL.split(), "--live", "--out", str(tmp_path)])
    assert shown(viewer[0])[-1] == ("iswarm_mj", 12)
    assert (tmp_path / "clean.rrd").stat().st_size > 10_000


def test_a_run_goes_on_without_its_viewer(viewer, capsys):
    url, process = viewer
    scene = make_scene(5, 2)
    frames = make_frames(scene, 9)
    with LiveRecording(url, scene, {}, {}) as recording:
        recording.append(frames[:4])
        assert ("iswarm_mj", 3) in shown(url)
        process.kill()
        process.wait()
        for start in (4, 6):
            recording.append(frames[start : start + 2])
    assert capsys.readouterr().err.count("the viewer was closed") == 1
