"""Pictures of runs: any number of robots, in the colours of their states, and clear errors."""

import subprocess
import sys
from pathlib import Path
from unittest.mock import MagicMock

import numpy as np
import pytest
from helpers_files import full_disk
from helpers_opengl import needs_opengl, of_colour
from helpers_recorded import write_run

from iswarm_mj.commands.main import main
from iswarm_mj.output.palette import DUMP, DUST, EMPTY, LOADED, SCOUT, rgb
from iswarm_mj.output.render import render
from iswarm_mj.output.saved import load
from iswarm_mj.output.stage import Shot, Stage
from iswarm_mj.utils.errors import UserError

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


@needs_opengl
@pytest.mark.parametrize(("width", "height"), [(400, 400), (240, 400), (640, 200)])
def test_the_oblique_camera_shows_the_whole_arena(directory, tmp_path, width, height):
    """Between arena and edge of the picture there is the plain surface around, which is bright; walls are dark."""
    from PIL import Image

    out = tmp_path / "a.png"
    code = "import sys; from iswarm_mj.commands.main import main; main(sys.argv[1:])"
    arguments = f"picture {directory} --step 0 --camera oblique --width {width} --height {height} --out {out}".split()
    done = subprocess.run([sys.executable, "-c", code, *arguments], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    with Image.open(out) as image:
        grey = np.asarray(image.convert("L")).astype(int)
    edges = np.concatenate([grey[0], grey[-1], grey[:, 0], grey[:, -1]])
    assert edges.min() > 150 > 120 > grey.min()
    dark = np.argwhere(grey < 120)
    assert max(np.ptp(dark[:, 0]) / height, np.ptp(dark[:, 1]) / width) > 0.8  # and it fills the picture


@needs_opengl
def test_picture_shows_the_robots_in_the_colours_of_their_states(directory, tmp_path):
    from PIL import Image

    out, size = tmp_path / "a.png", 900
    code = "import sys; from iswarm_mj.commands.main import main; main(sys.argv[1:])"
    arguments = f"picture {directory} --step 0 --width {size} --height {size} --out {out}".split()
    done = subprocess.run([sys.executable, "-c", code, *arguments], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    with Image.open(out) as image:
        pixels = np.asarray(image.convert("RGB")).astype(int)
    assert pixels.shape == (size, size, 3)
    high, low = int(size * (0.5 - 12.5 / 148)), int(size * (0.5 + 12.5 / 148))  # between the three kinds of robots
    for colour, rows in ((EMPTY, slice(0, high)), (SCOUT, slice(high, low)), (LOADED, slice(low, size))):
        found = of_colour(pixels, colour)
        assert found[rows].sum() > 0.7 * found.sum() > 500


@needs_opengl
def test_the_floor_has_the_colours_of_recordings(directory, monkeypatch):
    """Above all, dust areas are not blue as loaded robots are. Without OpenGL, which other tests use in processes."""
    monkeypatch.setattr("mujoco.Renderer", MagicMock())
    run = load(directory)
    with Stage(run.config, run.arrays, Shot(size=(64, 64))) as stage:
        for material, colour in (("dump", DUMP), ("dust", DUST)):
            shown = stage._arena.model.material(material).rgba[:3]
            np.testing.assert_allclose(255 * shown, rgb(colour), atol=1e-3)


def test_a_camera_that_does_not_exist_is_refused(directory, tmp_path, capsys):
    """The command says so before it looks for a run; for `Stage` the cameras of the model count."""
    with pytest.raises(SystemExit) as stop:
        main(["picture", "nowhere", "--camera", "side"])
    assert stop.value.code == 2 and "invalid choice 'side'" in capsys.readouterr().err
    with pytest.raises(UserError, match=r"^camera must be above or oblique \(got 'side'\)$"):
        render(directory, 0, Shot("side", size=(64, 64)), tmp_path / "a.png")


@pytest.mark.parametrize("step", [-1, 1])
def test_a_step_outside_the_run_is_refused(directory, tmp_path, step):
    with pytest.raises(UserError, match=rf"step must be a step of the run, 0 to 0 \(got {step}\)"):
        render(directory, step, Shot(size=(64, 64)), tmp_path / "a.png")


def test_a_run_that_ended_early_is_shown_at_its_end(directory, tmp_path, monkeypatch):
    monkeypatch.setattr("iswarm_mj.output.render.Stage", Blank)
    assert render(directory, None, Shot(size=(64, 64)), tmp_path / "a.png") == 0


class Blank:
    """In place of a stage: a picture that does not compress."""

    def __init__(self, config, frames, shot, *_):
        self.pixels = np.random.default_rng(0).integers(0, 255, (shot.size[1], shot.size[0], 3), np.uint8)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        pass

    def show(self, *_):
        return self.pixels


def test_a_full_disk_leaves_the_old_picture(directory, tmp_path, monkeypatch):
    monkeypatch.setattr("iswarm_mj.output.render.Stage", Blank)
    (tmp_path / "a.png").write_bytes(b"old")
    with pytest.raises(UserError, match=r"a\.png cannot be written \(File too large\); make room"), full_disk(1000):
        render(directory, 0, Shot(size=(64, 64)), tmp_path / "a.png")
    assert [path.name for path in tmp_path.iterdir()] == ["a.png"] and (tmp_path / "a.png").read_bytes() == b"old"


@pytest.mark.parametrize("out", ["", "a", "a.mp5", "a.png/"])
def test_names_that_are_no_picture(directory, tmp_path, monkeypatch, out):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a.png").mkdir()
    monkeypatch.setattr("iswarm_mj.output.render.Stage", Blank)
    with pytest.raises(UserError, match=r"a name ending in \.png|cannot be written"):
        render(directory, 0, Shot(size=(64, 64)), Path(out))
    assert [path.name for path in tmp_path.iterdir()] == ["a.png"]
