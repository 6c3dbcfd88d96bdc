"""Pictures of runs: any number of robots, in the colours of their states, and clear errors."""

import json
import subprocess
import sys
from dataclasses import asdict

import numpy as np
import pytest
from helpers_opengl import needs_opengl

from iswarm_mj.commands.main import main
from iswarm_mj.config import SwarmConfig
from iswarm_mj.output.render import render
from iswarm_mj.output.stage import Shot, load
from iswarm_mj.output.trajectory import RESULT, TRAJECTORY
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
    (out / RESULT).write_text(json.dumps({"config": asdict(SwarmConfig())}))
    np.savez(
        out / TRAJECTORY,
        step=np.array([0]),
        pose=pose[None].astype(np.float32),
        is_loaded=(kind == 0)[None],
        scene_is_scout=kind == 1,
        scene_ball_radius=np.full(2, 2e-5),
        ball_position=np.full((1, 2, 3), 2e-5),
    )
    return out


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
    red, green, blue = pixels[..., 0], pixels[..., 1], pixels[..., 2]
    high, low = int(size * (0.5 - 12.5 / 148)), int(size * (0.5 + 12.5 / 148))  # between the three kinds of robots
    for channel, others, rows in (
        (red, (green, blue), slice(0, high)),
        (green, (red, blue), slice(high, low)),
        (blue, (red, green), slice(low, size)),
    ):
        strong = (channel > 90) & (channel > 2 * others[0]) & (channel > 1.8 * others[1])
        assert strong[rows].sum() > 0.7 * strong.sum() > 500


def test_a_directory_without_a_run_is_refused(tmp_path):
    with pytest.raises(UserError, match=r"holds no readable result.json with trajectory.npz"):
        load(tmp_path)


def test_a_camera_that_does_not_exist_is_refused(directory, tmp_path, capsys):
    """The command says so before it looks for a run; for `Stage` the cameras of the model count."""
    with pytest.raises(SystemExit) as stop:
        main(["picture", "nowhere", "--camera", "side"])
    assert stop.value.code == 2 and "'--camera'" in capsys.readouterr().err
    with pytest.raises(UserError, match=r"^camera must be above or oblique \(got 'side'\)$"):
        render(directory, 0, Shot("side", size=(64, 64)), tmp_path / "a.png")


@pytest.mark.parametrize("step", [-1, 1])
def test_a_step_outside_the_run_is_refused(directory, tmp_path, step):
    with pytest.raises(UserError, match=rf"step must be a step of the run, 0 to 0 \(got {step}\)"):
        render(directory, step, Shot(size=(64, 64)), tmp_path / "a.png")
