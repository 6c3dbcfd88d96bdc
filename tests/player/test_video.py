"""Videos: the scene from two cameras, what hides what, colours, legends, and files of three kinds."""

import subprocess
import sys

import imageio_ffmpeg
import numpy as np
import pytest
from PIL import Image
from support.files import full_disk
from support.opengl import of_colour
from support.recorded import write_run

import iswarm_mj.player.video as video
from iswarm_mj import load
from iswarm_mj.output.palette import DUST, EMPTY, LOADED, SCOUT, rgb
from iswarm_mj.player.film import Film
from iswarm_mj.player.filming import frames_of
from iswarm_mj.player.painter import Look, Painter
from iswarm_mj.player.video import video_legend, write_video
from iswarm_mj.utils.errors import UserError

SIZE = (320, 240)
SQUARE = (400, 400)
FILM = Film(speed=12.0)
GREY = np.array(rgb("#e2e2de"))
"""Colour of the floor."""


@pytest.fixture
def run(tmp_path):
    """A run in which a robot walks 24 mm to the right in two steps, and is loaded at the end."""
    pose = np.array([[[x, 0.02, 0.0]] for x in (-0.012, 0.0, 0.012)], np.float32)
    return load(
        write_run(
            tmp_path,
            pose=pose,
            is_loaded=np.array([[False], [False], [True]]),
            scene_is_scout=np.array([False]),
            scene_dust_areas=np.zeros((0, 4)),
            scene_dump=np.zeros(4),
            scene_ball_radius=np.zeros(0),
            ball_position=np.zeros((3, 0, 3), np.float32),
        )
    )


def painted(run, step=1, share=1.0, **look):
    """Return the pixels of a time in a run, red, green and blue."""
    painter = Painter(run.scene, Look(**{"size": SQUARE, "n_caption_lines": 0} | look))
    frames = frames_of(run)
    picture = painter.paint([frames[step - 1 : step], frames[step : step + 1]], share)
    return picture[..., :3].astype(int)


class TestPicture:
    @pytest.mark.parametrize("camera", ["above", "oblique"])
    @pytest.mark.parametrize("size", [SIZE, SQUARE, (240, 320)])
    def test_the_whole_arena_is_shown_and_fills_the_picture(self, run, camera, size):
        """The walls are dark, and what surrounds them is white."""
        pixels = painted(run, camera=camera, size=size)
        edges = np.concatenate([pixels[0], pixels[-1], pixels[:, 0], pixels[:, -1]])
        assert edges.min() == 255
        row, column = np.nonzero((pixels < 150).all(axis=-1))
        assert max(np.ptp(row) / size[1], np.ptp(column) / size[0]) > 0.8

    def test_a_robot_moves_straight_in_the_colour_of_its_state(self, run):
        """A pixel is 150 / 400 mm; the robot is 20 mm above the middle."""
        columns = []
        for share in (0.0, 0.5, 1.0):
            row, column = np.nonzero(of_colour(painted(run, 1, share, camera="above"), EMPTY))
            assert row.mean() == pytest.approx(200 - 20 / 0.375, abs=2)
            columns.append(column.mean())
        assert np.diff(columns) == pytest.approx([6 / 0.375] * 2, abs=1)
        assert columns[2] == pytest.approx(200, abs=2)
        assert of_colour(painted(run, 2, 1.0, camera="above"), LOADED).sum() > 10

    def test_the_nearer_robot_hides_the_farther_one(self, tmp_path):
        """The camera looks down from the south; the scout stands 2.2 mm north of the other."""
        pose = np.array([[[0, 0, 0], [0, 0.0022, 0]]] * 2, np.float32)
        scouts = np.array([False, True])
        size = np.array([[0.002, 0.002, 0.006]] * 2)
        near = load(
            write_run(
                tmp_path, pose=pose, scene_is_scout=scouts, scene_robot_size=size, step=np.arange(2)
            )
        )
        pixels = painted(near, camera="oblique")
        n_scout = of_colour(pixels, SCOUT).sum()
        n_empty = of_colour(pixels, EMPTY).sum()
        assert n_scout < 0.6 * n_empty

    def test_a_disc_is_round(self, tmp_path):
        """Its pixels are pi / 4 of the square around it."""
        disc = np.full((3, 1, 3), (0.0, 0.0, 0.03))
        colour = (10, 160, 30)
        run = load(
            write_run(
                tmp_path,
                area_spot=disc,
                scene_area_names=np.array(["spot"]),
                scene_area_shapes=np.array(["disc"]),
                scene_area_colours=np.array([colour]),
                scene_dump=np.zeros(4),
                scene_dust_areas=np.zeros((0, 4)),
                pose=np.full((3, 1, 3), 0.06, np.float32),
                scene_is_scout=np.zeros(1, bool),
            )
        )
        is_disc = np.abs(painted(run, camera="above") - colour).max(axis=-1) < 60
        row, column = np.nonzero(is_disc)
        width, height = np.ptp(column) + 1, np.ptp(row) + 1
        assert width == height == pytest.approx(60 / 0.375, abs=4)
        assert is_disc.sum() / (width * height) == pytest.approx(np.pi / 4, rel=0.02)

    def test_links_are_drawn_if_wished(self, tmp_path):
        """Robot 0, at the left, hears robot 1 at the right; the middle of the link is grey."""
        pose = np.array([[[-0.02, 0, 0], [0.02, 0, 0]]] * 3, np.float32)
        valid = np.zeros((3, 2, 4), bool)
        valid[:, 0, 0] = True
        sender = np.where(valid, 1, 0).astype(np.int32)
        run = load(
            write_run(
                tmp_path,
                pose=pose,
                scene_is_scout=np.zeros(2, bool),
                scene_dump=np.zeros(4),
                scene_ball_radius=np.zeros(0),
                ball_position=np.zeros((3, 0, 3), np.float32),
                link_valid=valid,
                link_heard=valid,
                link_sender=sender,
            )
        )
        with_links = painted(run, camera="above", draw=("links",))[200, 200]
        without_links = painted(run, camera="above", draw=())[200, 200]
        np.testing.assert_array_equal(without_links, GREY)
        assert with_links.max() < 180

    def test_a_legend_stands_beside_the_arena(self, run):
        legend = [("dust", rgb(DUST)), ("a word", None)]
        size = (400, 240)
        pixels = painted(run, legend=legend, size=size)
        n_left = of_colour(pixels[:, :76], DUST).sum()
        assert n_left > 20
        walls = np.nonzero((pixels[:, 90:] < 150).all(axis=-1))[1] + 90
        assert walls.min() > 76

    def test_dark_pictures_have_a_dark_background(self, run):
        assert painted(run, is_dark=True)[0, 0].max() < 40


def test_the_legend_names_what_is_shown(run):
    frames = frames_of(run)
    labels = [label for label, _ in video_legend(run.scene, Film(draw=("links", "trails")), frames)]
    assert labels[0] == "empty"
    assert "empty, sends priority" not in labels  # as the messages have no such flag
    assert "link, heard" in labels and "link, damaged message" in labels
    assert not {"dump", "balls are drawn enlarged", "trail"} & {*labels}
    without_lines = [label for label, _ in video_legend(run.scene, Film(draw=()), frames)]
    assert "link, heard" not in without_lines


def decoded(path, size):
    """Return frames (T, height, width, 3) and the description of a video."""
    width, height = size
    reader = imageio_ffmpeg.read_frames(str(path))
    description = next(reader)
    frames = [np.frombuffer(frame, np.uint8).reshape(height, width, 3) for frame in reader]
    return np.array(frames), description


def test_videos_need_no_page():
    """The server of pages and replays belongs to another extra."""
    code = "import sys, iswarm_mj.player.video; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert not {"viser", "websockets", "msgspec"} & {*done.stdout.split()}


class TestFile:
    def test_mp4_has_all_pictures_at_their_rate(self, run, tmp_path):
        out = tmp_path / "a.mp4"
        assert write_video(run, FILM, out, size=SIZE) == 2
        frames, description = decoded(out, SIZE)
        assert len(frames) == 5
        assert (description["codec"], description["fps"]) == ("h264", 24)
        assert description["pix_fmt"].startswith("yuv420p")
        data = out.read_bytes()
        assert data.index(b"moov") < data.index(b"mdat")  # it plays while it loads

    def test_gif_and_webp_repeat_the_same_pictures(self, run, tmp_path):
        for suffix in ("gif", "webp"):
            out = tmp_path / f"a.{suffix}"
            write_video(run, FILM, out, camera="above", size=SIZE, has_legend=False)
            with Image.open(out) as image:
                assert (image.n_frames, image.size, image.info["loop"]) == (5, SIZE, 0)
                image.seek(3)
                row, column = np.nonzero(of_colour(np.asarray(image.convert("RGB")), LOADED))
            expected = painted(run, 2, 0.5, camera="above", size=SIZE)
            expected_row, expected_column = np.nonzero(of_colour(expected, LOADED))
            assert column.mean() == pytest.approx(expected_column.mean(), abs=1.5)
            assert row.mean() == pytest.approx(expected_row.mean(), abs=1.5)

    def test_a_gif_has_the_colours_of_its_first_picture(self, run, tmp_path, monkeypatch):
        """A painter paints all pictures on one canvas."""
        new_colour = (250, 20, 240)
        paint = Painter.paint

        def paint_with_a_mark_at_first(self, past, share, caption=()):
            picture = paint(self, past, share, caption)
            if share == 1 and past[-1].step[0] == 0:
                picture[:40, :40, :3] = new_colour
            return picture

        monkeypatch.setattr(Painter, "paint", paint_with_a_mark_at_first)
        write_video(run, FILM, tmp_path / "a.gif", size=SIZE, has_legend=False)
        with Image.open(tmp_path / "a.gif") as image:
            corner = np.asarray(image.convert("RGB"))[10, 10].astype(int)
        assert np.abs(corner - new_colour).max() < 12

    def test_a_part_of_the_run_with_its_captions(self, run, tmp_path, monkeypatch):
        captions = []

        class Counted(Painter):
            def paint(self, past, share, caption=()):
                captions.append((caption, int(past[-1].step[0]), share))
                return super().paint(past, share, caption)

        monkeypatch.setattr(video, "Painter", Counted)
        film = Film(first=1, last=2, frames_per_step=2, speed=6, title="few")
        write_video(run, film, tmp_path / "a.mp4", size=(64, 64))
        lines = ["few", "step 1", "0 of 0 balls delivered"]
        assert captions[0] == (lines, 1, 1.0)
        assert [entry[1:] for entry in captions] == [(1, 1.0), (2, 0.5), (2, 1.0)]
        assert captions[-1][0][1] == "step 2"

    def test_one_that_fails_leaves_the_old_one_and_no_other_file(self, run, tmp_path, monkeypatch):
        """Pictures that cannot be compressed do not fit on the disk."""
        rng = np.random.default_rng(0)
        noise = rng.integers(0, 255, (240, 320, 4), np.uint8)
        monkeypatch.setattr(Painter, "paint", lambda *_, **__: noise)
        directory = tmp_path / "out"
        directory.mkdir()
        out = directory / "a.mp4"
        out.write_bytes(b"old")
        film = Film(frames_per_step=24, speed=1)
        with pytest.raises(UserError, match=r"^ffmpeg could not write"), full_disk(20_000):
            write_video(run, film, out, size=SIZE)
        assert [path.name for path in directory.iterdir()] == ["a.mp4"]
        assert out.read_bytes() == b"old"

    @pytest.mark.parametrize(
        ("film", "out", "message"),
        [
            (Film(last=3), "a.mp4", "up to 2"),
            (Film(first=2), "a.mp4", "up to 2"),
            (Film(colour_by="hops"), "a.mp4", "colour_by must be state"),
            (Film(draw=("vectors",)), "a.mp4", "some of links, trails"),
            (Film(speed=31), "a.mp4", "at most 60 pictures per second"),
            (Film(), "a.avi", r"\.mp4 or \.gif or \.webp"),
        ],
    )
    def test_what_cannot_be_shown_is_named(self, run, tmp_path, film, out, message):
        with pytest.raises(UserError, match=message):
            write_video(run, film, tmp_path / out)

    def test_arrays_that_do_not_fit_are_not_drawn(self, tmp_path):
        run = load(write_run(tmp_path, scene_area_shapes=np.array(["disc"])))
        with pytest.raises(UserError, match="the recorded arrays do not fit each other"):
            write_video(run, FILM, tmp_path / "a.mp4")
        assert not list(tmp_path.glob("a.*"))
