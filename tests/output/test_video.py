"""Videos of runs: what ffmpeg makes of known pictures, robots between two steps, and clear errors."""

import subprocess
import sys

import imageio_ffmpeg
import numpy as np
import pytest
from helpers_files import full_disk
from helpers_opengl import needs_opengl, of_colour
from helpers_recorded import write_run

from iswarm_mj.commands.main import main
from iswarm_mj.output.palette import EMPTY, LOADED
from iswarm_mj.output.stage import Shot
from iswarm_mj.output.video import RATE, Film, encode, interpolated, write_video
from iswarm_mj.utils.errors import UserError


def decoded(path, size):
    """Frames (T, height, width, 3) and the description of a video."""
    reader = imageio_ffmpeg.read_frames(str(path))
    about = next(reader)
    frames = [np.frombuffer(frame, np.uint8).reshape(size[1], size[0], 3) for frame in reader]
    return np.array(frames), about


def test_pictures_come_back(tmp_path):
    """A bright square that moves by 20 pixels a frame is found where it was, in H.264 that all players know."""
    size, out = (160, 96), tmp_path / "a.mp4"

    def pictures():
        for k in range(6):
            picture = np.full((size[1], size[0], 3), 40, np.uint8)
            picture[30:60, 10 + 20 * k : 40 + 20 * k] = (230, 60, 50)
            yield picture

    encode(pictures(), out, size)
    frames, about = decoded(out, size)
    assert about["codec"] == "h264" and about["pix_fmt"].startswith("yuv420p") and about["fps"] == RATE
    assert len(frames) == 6
    for k, frame in enumerate(frames.astype(float)):
        bright = frame[..., 0] > 150
        rows, columns = np.nonzero(bright)
        assert abs(rows.mean() - 44.5) < 1 and abs(columns.mean() - (24.5 + 20 * k)) < 1
        assert frame[bright].mean(axis=0) == pytest.approx((230, 60, 50), abs=15)
    data = out.read_bytes()
    assert data.index(b"moov") < data.index(b"mdat"), "the index comes first, so that it plays while it loads"


def test_robots_go_straight_between_two_steps():
    values = np.array([[[0.0, 2.0]], [[1.0, 4.0]], [[5.0, 4.0]]])
    assert interpolated(values, 0, 0.0).tolist() == [[0, 2]]
    assert interpolated(values, 0, 0.25).tolist() == [[0.25, 2.5]]
    assert interpolated(values, 2, 0.0).tolist() == [[5, 4]]


@pytest.mark.parametrize(
    "flags, said",
    [
        (["--width", "641"], "--width must be an even number"),
        (["--frames-per-step", "0"], "--frames-per-step must be a whole number between 1 and 24"),
        (["--camera", "side"], "invalid choice 'side'"),
        (["--out", "a.avi"], "--out must be a name ending in .mp4 (got 'a.avi')"),
    ],
)
def test_bad_flags_end_with_a_sentence(flags, said, capsys):
    with pytest.raises(SystemExit) as stop:
        main(["video", "nowhere", *flags])
    assert stop.value.code == 2 and said in capsys.readouterr().err


@needs_opengl
def test_a_run_is_filmed(small, tmp_path):
    """Two frames a step, the last step once; a robot that turns blue when it is loaded."""
    pose = np.array([[[-0.012, 0.008, 0.0]], [[0.0, 0.008, 0.0]], [[0.012, 0.008, 0.0]]], np.float32)
    write_run(
        tmp_path,
        small,
        pose=pose,
        is_loaded=np.array([[False], [False], [True]]),
        scene_is_scout=np.array([False]),
        scene_ball_radius=np.array([2e-5]),
        ball_position=np.tile(np.float32([0.015, -0.015, 2e-5]), (3, 1, 1)),
    )
    out, size = tmp_path / "a.mp4", (640, 480)
    code = "import sys; from iswarm_mj.commands.main import main; main(sys.argv[1:])"
    flags = ["--camera", "above", "--width", "640", "--height", "480", "--title", "one robot", "--out", str(out)]
    done = subprocess.run([sys.executable, "-c", code, "video", str(tmp_path), *flags], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    frames = decoded(out, size)[0].astype(int)
    assert len(frames) == 5
    upper = frames[:, :236]  # above the dump and the dust areas; the caption is grey

    def columns(frame, colour):
        return np.nonzero(of_colour(frame, colour))[1]

    empty = [columns(frame, EMPTY) for frame in upper[:4]]
    assert all(len(found) > 4 for found in empty)
    assert np.diff([found.mean() for found in empty]) == pytest.approx([empty[1].mean() - empty[0].mean()] * 3, abs=2)
    assert empty[2].mean() == pytest.approx(320, abs=3)
    assert len(columns(upper[4], LOADED)) > 4 and len(columns(upper[4], EMPTY)) <= 2


@pytest.fixture
def directory(tmp_path_factory):
    """Of a recorded run of two steps."""
    return write_run(tmp_path_factory.mktemp("run"))


def noise(n, size=(160, 96)):
    rng = np.random.default_rng(0)
    return (rng.integers(0, 255, (size[1], size[0], 3), np.uint8) for _ in range(n))


def test_a_full_disk_is_told_in_one_sentence(tmp_path):
    said = r"^ffmpeg could not write the video \([^\n]+\); make room or choose"
    with pytest.raises(UserError, match=said), full_disk(20_000):
        encode(noise(40), tmp_path / "a.mp4", (160, 96))


def test_what_ffmpeg_said_is_told(tmp_path):
    with pytest.raises(UserError, match=r"^ffmpeg could not write the video \(.*No such file or directory\); make"):
        encode(noise(2), tmp_path / "nowhere" / "a.mp4", (160, 96))


def test_a_video_that_fails_leaves_the_old_one(directory, tmp_path, monkeypatch):
    """Whatever the reason, and without a temporary file."""
    out = tmp_path / "a.mp4"
    out.write_bytes(b"old")

    class Blank:
        def __init__(self, config, frames, shot, *_):
            self.size = shot.size

        def __enter__(self):
            return self

        def __exit__(self, *_):
            pass

        def show(self, *_):
            return next(noise(1, self.size))

    monkeypatch.setattr("iswarm_mj.output.video.Stage", Blank)
    film = Film(frames_per_step=24, shot=Shot(size=(320, 240)))
    with pytest.raises(UserError, match=r"^ffmpeg could not write"), full_disk(20_000):
        write_video(directory, out, film)
    assert [path.name for path in tmp_path.iterdir()] == ["a.mp4"] and out.read_bytes() == b"old"
    write_video(directory, out, film)
    assert len(decoded(out, (320, 240))[0]) == 49
