"""Pictures and videos of runs: any number of robots, in the colours of their states, and clear errors."""

import subprocess
import sys
from unittest.mock import MagicMock

import imageio_ffmpeg
import mujoco
import numpy as np
import pytest
from PIL import Image
from support.files import full_disk
from support.opengl import needs_opengl, of_colour
from support.recorded import write_run

from iswarm_mj.config.swarm import ArenaConfig, SwarmConfig
from iswarm_mj.geometry.walls import area_of
from iswarm_mj.output import video
from iswarm_mj.output.loading import load
from iswarm_mj.output.offscreen import ArenaRenderer, Shot, render
from iswarm_mj.output.palette import DUMP, DUST, EMPTY, LOADED, SCOUT, rgb
from iswarm_mj.output.shapes import floor
from iswarm_mj.output.video import RATE, write_video
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.units import ROBOT_DIAMETER, mm_from_rd

N = 330
"""More than 280: MuJoCo's memory for collisions must not limit a picture."""


@pytest.fixture(scope="module")
def directory(tmp_path_factory):
    """A run's directory with one frame: robots on a grid, the first third loaded, the second scouts."""
    out = tmp_path_factory.mktemp("run")
    grid = np.stack(np.meshgrid(np.arange(22), np.arange(15)), axis=-1).reshape(-1, 2)[:N]
    pose = np.column_stack([(grid - [10.5, 7]) * 5e-3, np.zeros(N)])
    pose[:, 1] += 1e-3 * np.sign(pose[:, 1])
    kind = np.arange(N) * 3 // N
    return write_run(
        out,
        step=np.array([0]),
        pose=pose[None].astype(np.float32),
        is_loaded=(kind == 0)[None],
        scene_is_scout=kind == 1,
        scene_ball_radius=np.full(2, 2e-5),
        ball_position=np.full((1, 2, 3), 2e-5),
        delivered=np.array([0]),
    )


OBLIQUE, SIZE, FILM = [(120, 200), (320, 100)], 400, (640, 480)


@pytest.fixture(scope="module")
def drawn(directory, small, tmp_path_factory):
    """Directory of pictures of the run and of an emptier one, and of a film, drawn in a process of their own."""
    out, few = tmp_path_factory.mktemp("drawn"), write_run(tmp_path_factory.mktemp("few"))
    pose = np.array([[[x, 0.008, 0.0]] for x in (-0.012, 0.0, 0.012, 0.012)], np.float32)
    write_run(
        out,
        small,
        step=np.arange(4),
        pose=pose,
        is_loaded=np.array([[False], [False], [True], [True]]),
        scene_is_scout=np.array([False]),
        scene_ball_radius=np.array([2e-5]),
        ball_position=np.tile(np.float32([0.015, -0.015, 2e-5]), (4, 1, 1)),
    )
    lines = [f"picture {directory} --step 0 --width {SIZE} --height {SIZE} --out {out}/above.png"]
    lines += [
        f"picture {few} --step 0 --camera oblique --width {w} --height {h} --out {out}/{w}x{h}.png" for w, h in OBLIQUE
    ]
    lines += [
        f"video {out} --steps 2 --camera above --width {FILM[0]} --height {FILM[1]} --title robot --out {out}/a.mp4"
    ]
    code = "import sys; from iswarm_mj.commands.main import main; [main(line.split()) for line in sys.argv[1:]]"
    done = subprocess.run([sys.executable, "-c", code, *lines], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return out


@needs_opengl
@pytest.mark.parametrize(("width", "height"), OBLIQUE)
def test_the_oblique_camera_shows_the_whole_arena(drawn, width, height):
    """Between arena and edge of the picture there is the plain surface around, which is bright; walls are dark."""
    with Image.open(drawn / f"{width}x{height}.png") as image:
        grey = np.asarray(image.convert("L")).astype(int)
    edges = np.concatenate([grey[0], grey[-1], grey[:, 0], grey[:, -1]])
    assert edges.min() > 150 > 120 > grey.min()
    dark = np.argwhere(grey < 120)
    assert max(np.ptp(dark[:, 0]) / height, np.ptp(dark[:, 1]) / width) > 0.8  # and it fills the picture


@needs_opengl
def test_picture_shows_the_robots_in_the_colours_of_their_states(drawn):
    with Image.open(drawn / "above.png") as image:
        pixels = np.asarray(image.convert("RGB")).astype(int)
    assert pixels.shape == (SIZE, SIZE, 3)
    high, low = int(SIZE * (0.5 - 12.5 / 148)), int(SIZE * (0.5 + 12.5 / 148))  # between the three kinds of robots
    for colour, rows in ((EMPTY, slice(0, high)), (SCOUT, slice(high, low)), (LOADED, slice(low, SIZE))):
        found = of_colour(pixels, colour)
        assert found[rows].sum() > 0.7 * found.sum() > 500


@needs_opengl
def test_a_run_is_filmed(drawn):
    """Two frames a step, step 2 as the last one once; a robot that turns blue when it is loaded."""
    frames = decoded(drawn / "a.mp4", FILM)[0].astype(int)
    assert len(frames) == 5
    upper = frames[:, :236]  # above the dump and the dust areas; the caption is grey

    def columns(frame, colour):
        return np.nonzero(of_colour(frame, colour))[1]

    empty = [columns(frame, EMPTY) for frame in upper[:4]]
    assert all(len(found) > 4 for found in empty)
    assert np.diff([found.mean() for found in empty]) == pytest.approx([empty[1].mean() - empty[0].mean()] * 3, abs=2)
    assert empty[2].mean() == pytest.approx(320, abs=3)
    assert len(columns(upper[4], LOADED)) > 4 and len(columns(upper[4], EMPTY)) <= 2


class WithoutOpenGL:
    """MuJoCo's renderer, which other tests use in processes of their own, without OpenGL."""

    def __init__(self, model, height, width, max_geom):
        self.scene = mujoco.MjvScene(model, max_geom)

    def __getattr__(self, name):
        return lambda *_: None


def test_a_stage_shows_robots_balls_and_areas_between_two_steps(tmp_path, monkeypatch):
    """A quarter of the way from step 1 to 2; in the colours of recordings, and balls 15 times as large as they are."""
    monkeypatch.setattr("mujoco.Renderer", WithoutOpenGL)
    rng, names = np.random.default_rng(3), ["spot", "ring"]
    areas = {f"area_{name}": rng.uniform(1e-3, 9e-3, (3, 2, 3)) for name in names}
    about = {"names": names, "shapes": ["square", "disc"], "colours": [[10, 20, 30], [40, 50, 60]]}
    more = areas | {f"scene_area_{part}": np.array(values) for part, values in about.items()}
    more |= {"is_loaded": np.arange(12).reshape(3, 4) == 6, "scene_is_scout": np.arange(4) > 2}
    more |= {"scene_dust_areas": np.zeros((0, 4)), "ball_position": rng.uniform(0, 9e-3, (3, 2, 3)).astype(np.float32)}
    run = load(write_run(tmp_path, **more))
    with ArenaRenderer(run.config, run.arrays, Shot(size=(64, 64))) as stage:
        stage.show(run.arrays, 1, 0.25)
        model, data, drawn = stage.arena.model, stage.data, stage.visual_scene
    pose, balls = (
        1e3 * (0.75 * run.arrays[name][1] + 0.25 * run.arrays[name][2]) for name in ("pose", "ball_position")
    )
    hulls = [f"robot{robot}/substrate" for robot in range(4)]
    np.testing.assert_allclose([data.geom(name).xpos[:2] for name in hulls], pose[:, :2], atol=1e-5)
    colours = [rgb(colour) for colour in (EMPTY, EMPTY, LOADED, SCOUT)]
    np.testing.assert_allclose([255 * model.geom(name).rgba[:3] for name in hulls], colours, atol=1e-3)
    np.testing.assert_allclose(data.mocap_pos[stage.arena.mocap], balls, atol=1e-5)
    assert model.geom("ball1/ball").size[0] == pytest.approx(15 * 2e-2)
    for material, colour in (("dump", DUMP), ("dust", DUST)):  # above all, dust is not blue as loaded robots are
        np.testing.assert_allclose(255 * model.material(material).rgba[:3], rgb(colour), atol=1e-3)
    assert model.geom("dump").size[0] > 1 > 1e-5 > model.geom("dust_west").size[0]  # of which the task has none
    shown = drawn.geoms[: drawn.ngeom]
    box, cylinder = mujoco.mjtGeom.mjGEOM_BOX, mujoco.mjtGeom.mjGEOM_CYLINDER
    assert [geom.type for geom in shown] == [box, box, cylinder, cylinder]
    places = 1e3 * np.concatenate([areas[f"area_{name}"][1] for name in names])
    np.testing.assert_allclose([[*geom.pos[:2], geom.size[0]] for geom in shown], places, rtol=1e-5)
    np.testing.assert_allclose([255 * geom.rgba[:3] for geom in shown[::2]], about["colours"], atol=1e-3)


@pytest.mark.parametrize("corners", [((0, -12), (12, -4), (5, 13), (-12, 2)), ((20, 30),)])
def test_the_floor_ends_at_the_walls(corners, tmp_path, monkeypatch):
    """In pictures, and in what recordings and the page draw: as large as the arena, with corners at its corners."""
    monkeypatch.setattr("mujoco.Renderer", MagicMock())
    arena = ArenaConfig(outline=corners, n_dust=2, dump_size=4, dust_area_size=2, dust_area_offset=5)
    frames = {"scene_corners": np.array(arena.corners) * ROBOT_DIAMETER, "scene_arena_size": np.array(0.1)}
    run = load(write_run(tmp_path, SwarmConfig(arena), **frames))
    vertices, triangles = floor(run.scene)
    np.testing.assert_allclose(vertices[:, :2], mm_from_rd(np.array(arena.corners)))
    first, second, third = vertices[triangles].swapaxes(0, 1)
    area = np.cross(second - first, third - first)[:, 2] / 2
    assert area.min() > 0 and area.sum() == pytest.approx(area_of(mm_from_rd(np.array(arena.corners))))
    with ArenaRenderer(run.config, run.arrays, Shot(size=(64, 64))) as stage:
        model = stage.arena.model
        geom = model.geom("floor")
        turned = np.zeros(9)
        mujoco.mju_quat2Mat(turned, geom.quat)
        seen = model.mesh_vert @ turned.reshape(3, 3).T + geom.pos
    top = seen[np.isclose(seen[:, 2], -0.004, atol=1e-6)][:, :2]
    np.testing.assert_allclose(np.sort(top, axis=0), np.sort(vertices[:, :2], axis=0), atol=1e-4)


@pytest.mark.parametrize(
    ("shot", "step", "out", "says"),
    [
        ("side", 0, "a.png", "camera must be above or oblique"),
        ("above", 3, "a.png", "0 to 2"),
        ("above", 0, "a.mp5", r"a name ending in \.png or \.jpg"),
    ],
)
def test_what_a_run_does_not_have_is_refused(tmp_path, shot, step, out, says):
    with pytest.raises(UserError, match=says):
        render(write_run(tmp_path), step, Shot(shot, size=(64, 64)), tmp_path / out)


@pytest.mark.parametrize("is_video", [False, True])
def test_arrays_that_do_not_fit_are_not_drawn(tmp_path, is_video):
    run = write_run(tmp_path, scene_area_shapes=np.array(["disc"]))
    with pytest.raises(UserError, match="the recorded arrays do not fit each other"):
        if is_video:
            write_video(run, tmp_path / "a.mp4", Shot(size=(64, 64)))
        else:
            render(run, 1, Shot(size=(64, 64)), tmp_path / "a.png")
    assert not list(tmp_path.glob("a.*"))


def test_a_run_that_ended_early_is_shown_at_its_end(directory, tmp_path, monkeypatch):
    monkeypatch.setattr("iswarm_mj.output.offscreen.ArenaRenderer", Blank)
    assert render(directory, None, Shot(size=(64, 64)), tmp_path / "a.png") == 0


class Blank:
    """In place of a stage: a picture that does not compress."""

    def __init__(self, config, frames, shot, *_):
        self.rng, self.shape = np.random.default_rng(0), (shot.size[1], shot.size[0], 3)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        pass

    def show(self, *_):
        return self.rng.integers(0, 255, self.shape, np.uint8)


def decoded(path, size):
    """Frames (T, height, width, 3) and the description of a video."""
    reader = imageio_ffmpeg.read_frames(str(path))
    about = next(reader)
    frames = [np.frombuffer(frame, np.uint8).reshape(size[1], size[0], 3) for frame in reader]
    return np.array(frames), about


def test_a_video_that_fails_leaves_the_old_one(tmp_path_factory, tmp_path, monkeypatch):
    """Whatever the reason, and without a temporary file. Above are the title, the step, and metrics of the task."""
    about = {"scene_metric_names": ["share"], "scene_metric_units": [""], "scene_metric_descriptions": [""]}
    run, out = write_run(tmp_path_factory.mktemp("run"), **about, metric_share=[0.1, 0.25, 0.5]), tmp_path / "a.mp4"
    said, captioned = [], video._captioned
    monkeypatch.setattr(video, "_captioned", lambda pixels, lines: (said.append(lines), captioned(pixels, lines))[1])
    out.write_bytes(b"old")

    monkeypatch.setattr("iswarm_mj.output.video.ArenaRenderer", Blank)
    film = Shot(size=(320, 240)), 24
    with pytest.raises(UserError, match=r"^ffmpeg could not write"), full_disk(20_000):
        write_video(run, out, *film)
    assert [path.name for path in tmp_path.iterdir()] == ["a.mp4"] and out.read_bytes() == b"old"
    said.clear()
    write_video(run, out, *film, steps=99, title="few")
    assert said[::24] == [["few", f"step {step}", f"share {share}"] for step, share in enumerate((0.1, 0.25, 0.5))]
    frames, about = decoded(out, (320, 240))
    assert len(frames) == 49  # of all steps, which are fewer
    assert about["codec"] == "h264" and about["pix_fmt"].startswith("yuv420p") and about["fps"] == RATE
    data = out.read_bytes()
    assert data.index(b"moov") < data.index(b"mdat"), "the index comes first, so that it plays while it loads"
