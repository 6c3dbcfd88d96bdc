"""Videos of runs: what ffmpeg makes of known pictures, robots between two steps, and clear errors."""

import imageio_ffmpeg
import numpy as np
import pytest
from helpers_files import full_disk
from helpers_recorded import write_run

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


@pytest.fixture
def directory(tmp_path_factory):
    """Of a recorded run of two steps."""
    return write_run(tmp_path_factory.mktemp("run"))


def noise(n, size=(160, 96)):
    rng = np.random.default_rng(0)
    return (rng.integers(0, 255, (size[1], size[0], 3), np.uint8) for _ in range(n))


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
