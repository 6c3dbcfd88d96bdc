"""Pictures of runs: any number of robots, colours of their states, and clear errors."""

import subprocess
import sys
from unittest.mock import MagicMock

import mujoco
import numpy as np
import pytest
from PIL import Image
from support.opengl import needs_opengl, of_colour
from support.recorded import write_run

from iswarm_mj.config.arena import ArenaConfig
from iswarm_mj.config.swarm import SwarmConfig
from iswarm_mj.geometry.walls import area_of
from iswarm_mj.output.loading import load
from iswarm_mj.output.offscreen import ArenaRenderer, Shot, render
from iswarm_mj.output.palette import DUMP, DUST, EMPTY, LOADED, SCOUT, rgb
from iswarm_mj.output.shapes import floor
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.units import ROBOT_DIAMETER, mm_from_rd

SIZE = 400
"""Width and height of the picture from above [pixels]."""
OBLIQUE_SIZES = [(120, 200), (320, 100)]
SMALL_SHOT = Shot(size=(64, 64))


def write_grid(out, n_columns):
    """Write a run with one frame of robots on a grid of 15 rows: loaded ones, scouts, others."""
    n_robots = 15 * n_columns
    x, y = np.meshgrid(np.linspace(-0.0525, 0.0525, n_columns), 5e-3 * (np.arange(15) - 7))
    pose = np.column_stack([x.ravel(), y.ravel(), np.zeros(n_robots)])
    pose[:, 1] += 1e-3 * np.sign(pose[:, 1])  # away from the axis
    third = np.arange(n_robots) * 3 // n_robots
    return write_run(
        out,
        step=np.array([0]),
        pose=pose[None].astype(np.float32),
        is_loaded=(third == 0)[None],
        scene_is_scout=third == 1,
        scene_ball_radius=np.full(2, 2e-5),
        ball_position=np.full((1, 2, 3), 2e-5),
        delivered=np.array([0]),
    )


@pytest.fixture(scope="module")
def directory(tmp_path_factory):
    """Directory of a run of 120 robots."""
    return write_grid(tmp_path_factory.mktemp("run"), 8)


@pytest.fixture(scope="module")
def drawn(directory, tmp_path_factory):
    """Directory of pictures, which a process of its own draws."""
    out = tmp_path_factory.mktemp("drawn")
    few_robots = write_run(tmp_path_factory.mktemp("few"))
    above = f"picture {directory} --step 0 --width {SIZE} --height {SIZE} --out {out}/above.png"
    lines = [above]
    for width, height in OBLIQUE_SIZES:
        size = f"--width {width} --height {height}"
        path = f"{out}/{width}x{height}.png"
        lines.append(f"picture {few_robots} --step 0 --camera oblique {size} --out {path}")

    code = """
import sys
from iswarm_mj.commands.main import main
for line in sys.argv[1:]:
    main(line.split())
"""
    done = subprocess.run([sys.executable, "-c", code, *lines], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return out


@needs_opengl
@pytest.mark.parametrize(("width", "height"), OBLIQUE_SIZES)
def test_the_oblique_camera_shows_the_whole_arena(drawn, width, height):
    """The walls are dark, the surface around is bright, and the arena fills the picture."""
    with Image.open(drawn / f"{width}x{height}.png") as image:
        grey = np.asarray(image.convert("L")).astype(int)
    edges = np.concatenate([grey[0], grey[-1], grey[:, 0], grey[:, -1]])
    assert edges.min() > 150 > 120 > grey.min()
    row, column = np.nonzero(grey < 120)
    assert max(np.ptp(row) / height, np.ptp(column) / width) > 0.8


@needs_opengl
def test_a_picture_shows_the_robots_in_the_colours_of_their_states(drawn):
    with Image.open(drawn / "above.png") as image:
        pixels = np.asarray(image.convert("RGB")).astype(int)
    assert pixels.shape == (SIZE, SIZE, 3)

    # The rows of pixels between the three groups of robots, at 12.5 of 148 mm from the middle.
    upper_border = int(SIZE * (0.5 - 12.5 / 148))
    lower_border = int(SIZE * (0.5 + 12.5 / 148))
    for colour, rows in (
        (EMPTY, slice(0, upper_border)),
        (SCOUT, slice(upper_border, lower_border)),
        (LOADED, slice(lower_border, SIZE)),
    ):
        has_colour = of_colour(pixels, colour)
        assert has_colour[rows].sum() > 0.7 * has_colour.sum() > 180


@needs_opengl
@pytest.mark.slow
def test_memory_for_collisions_does_not_limit_the_number_of_robots(tmp_path):
    """MuJoCo's suffices for 280."""
    run = write_grid(tmp_path, 22)
    assert render(run, 0, SMALL_SHOT, tmp_path / "a.png") == 0


class WithoutOpenGL:
    """Replacement of MuJoCo's renderer, which needs no OpenGL and has a scene for further geoms."""

    def __init__(self, model, height, width, max_geom):
        self.scene = mujoco.MjvScene(model, max_geom)

    def __getattr__(self, name):
        return lambda *_: None


class TestRenderer:
    """The scene that is rendered a quarter of the way from step 1 to step 2."""

    SPOTS, RINGS = np.random.default_rng(3).uniform(1e-3, 9e-3, (2, 3, 2, 3))
    """Two squares and two discs in each of three frames: x, y and half width or radius [m]."""
    AREAS = {"area_spot": SPOTS, "area_ring": RINGS}  # noqa: RUF012, which no test changes
    COLOURS = ((10, 20, 30), (40, 50, 60))

    @pytest.fixture
    def run(self, tmp_path):
        """A run of four robots: the third is loaded in step 1, the fourth is a scout."""
        rng = np.random.default_rng(4)
        return load(
            write_run(
                tmp_path,
                **self.AREAS,
                scene_area_names=np.array(["spot", "ring"]),
                scene_area_shapes=np.array(["square", "disc"]),
                scene_area_colours=np.array(self.COLOURS),
                is_loaded=np.arange(12).reshape(3, 4) == 6,
                scene_is_scout=np.arange(4) > 2,
                scene_dust_areas=np.zeros((0, 4)),
                ball_position=rng.uniform(0, 9e-3, (3, 2, 3)).astype(np.float32),
            )
        )

    @pytest.fixture
    def renderer(self, run, monkeypatch):
        monkeypatch.setattr("mujoco.Renderer", WithoutOpenGL)
        with ArenaRenderer(run.config, run.arrays, SMALL_SHOT) as renderer:
            renderer.show(run.arrays, 1, 0.25)
            yield renderer

    def between_steps(self, values):
        """Values a quarter of the way from step 1 to step 2, lengths in mm."""
        return 1e3 * (0.75 * values[1] + 0.25 * values[2])

    def test_robots_and_balls_move_straight(self, renderer, run):
        pose = self.between_steps(run.arrays["pose"])
        hulls = [renderer.data.geom(f"robot{robot}/substrate").xpos[:2] for robot in range(4)]
        np.testing.assert_allclose(hulls, pose[:, :2], atol=1e-5)
        balls = self.between_steps(run.arrays["ball_position"])
        positions = renderer.data.mocap_pos[renderer.arena.mocap]
        np.testing.assert_allclose(positions, balls, atol=1e-5)

    def test_robots_have_the_colours_of_their_states(self, renderer):
        model = renderer.arena.model
        colours = [model.geom(f"robot{robot}/substrate").rgba[:3] for robot in range(4)]
        expected = [rgb(colour) for colour in (EMPTY, EMPTY, LOADED, SCOUT)]
        np.testing.assert_allclose(255 * np.array(colours), expected, atol=1e-3)

    def test_balls_are_15_times_as_large_as_they_are(self, renderer):
        ball = renderer.arena.model.geom("ball1/ball")
        assert ball.size[0] == pytest.approx(15 * 2e-2)

    def test_dump_and_dust_look_as_in_recordings(self, renderer):
        """Above all, dust is not blue like loaded robots; areas that the task lacks are hidden."""
        model = renderer.arena.model
        for material, colour in (("dump", DUMP), ("dust", DUST)):
            shown = 255 * model.material(material).rgba[:3]
            np.testing.assert_allclose(shown, rgb(colour), atol=1e-3)
        assert model.geom("dump").size[0] > 1
        assert model.geom("dust_west").size[0] < 1e-5

    def test_areas_of_the_task_are_painted(self, renderer):
        scene = renderer.visual_scene
        geoms = scene.geoms[: scene.ngeom]
        box = mujoco.mjtGeom.mjGEOM_BOX
        cylinder = mujoco.mjtGeom.mjGEOM_CYLINDER
        assert [geom.type for geom in geoms] == [box, box, cylinder, cylinder]
        places = 1e3 * np.concatenate([areas[1] for areas in self.AREAS.values()])
        shown = [[*geom.pos[:2], geom.size[0]] for geom in geoms]
        np.testing.assert_allclose(shown, places, rtol=1e-5)
        colours = [255 * geom.rgba[:3] for geom in geoms[::2]]
        np.testing.assert_allclose(colours, self.COLOURS, atol=1e-3)

    def test_there_is_room_for_all_areas_beside_all_bodies(self, run, monkeypatch):
        """A task may have any number of areas; MuJoCo has room for a fixed number of geoms."""
        renderer_of_mujoco = MagicMock()
        monkeypatch.setattr("mujoco.Renderer", renderer_of_mujoco)
        many = np.tile(self.SPOTS, (1, 500, 1))
        arrays = {**run.arrays, "area_spot": many}
        with ArenaRenderer(run.config, arrays, SMALL_SHOT) as renderer:
            n_bodies = renderer.arena.model.ngeom
        max_geom = renderer_of_mujoco.call_args.kwargs["max_geom"]
        assert max_geom == n_bodies + 1000 + 2


class TestFloor:
    """The floor ends at the walls, in pictures and in what recordings and the page draw."""

    @pytest.fixture(params=[((0, -12), (12, -4), (5, 13), (-12, 2)), ((20, 30),)])
    def run(self, request, tmp_path):
        """A run in an arena with other corners."""
        arena = ArenaConfig(
            outline=request.param, n_dust=2, dump_size=4, dust_area_size=2, dust_area_offset=5
        )
        corners = np.array(arena.corners) * ROBOT_DIAMETER
        changes = {"scene_corners": corners, "scene_arena_size": np.array(0.1)}
        return load(write_run(tmp_path, SwarmConfig(arena), **changes))

    def test_it_is_a_mesh_as_large_as_the_arena(self, run):
        corners = mm_from_rd(np.array(run.config.arena.corners))
        vertices, triangles = floor(run.scene)
        np.testing.assert_allclose(vertices[:, :2], corners)
        first, second, third = vertices[triangles].swapaxes(0, 1)
        areas = np.cross(second - first, third - first)[:, 2] / 2
        assert areas.min() > 0 and areas.sum() == pytest.approx(area_of(corners))

    def test_pictures_show_this_mesh(self, run, monkeypatch):
        monkeypatch.setattr("mujoco.Renderer", MagicMock())
        with ArenaRenderer(run.config, run.arrays, SMALL_SHOT) as renderer:
            model = renderer.arena.model
            geom = model.geom("floor")
            rotation = np.zeros(9)
            mujoco.mju_quat2Mat(rotation, geom.quat)
            shown = model.mesh_vert @ rotation.reshape(3, 3).T + geom.pos
        top = shown[np.isclose(shown[:, 2], -0.004, atol=1e-6)][:, :2]
        vertices, _ = floor(run.scene)
        expected = np.sort(vertices[:, :2], axis=0)
        np.testing.assert_allclose(np.sort(top, axis=0), expected, atol=1e-4)


class TestErrors:
    @pytest.mark.parametrize(
        ("camera", "step", "out", "message"),
        [
            ("side", 0, "a.png", "camera must be above or oblique"),
            ("above", 3, "a.png", "0 to 2"),
            ("above", 0, "a.mp5", r"a name ending in \.png or \.jpg"),
        ],
    )
    def test_wrong_arguments_are_named(self, tmp_path, camera, step, out, message):
        shot = Shot(camera, size=(64, 64))
        with pytest.raises(UserError, match=message):
            render(write_run(tmp_path), step, shot, tmp_path / out)

    def test_arrays_that_do_not_fit_are_not_drawn(self, tmp_path):
        run = write_run(tmp_path, scene_area_shapes=np.array(["disc"]))
        with pytest.raises(UserError, match="the recorded arrays do not fit each other"):
            render(run, 1, SMALL_SHOT, tmp_path / "a.png")
        assert not list(tmp_path.glob("a.*"))


class NoiseRenderer:
    """Replacement of a renderer, with pictures that cannot be compressed."""

    def __init__(self, config, frames, shot, *_):
        width, height = shot.size
        self.rng = np.random.default_rng(0)
        self.shape = (height, width, 3)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        pass

    def show(self, *_):
        return self.rng.integers(0, 255, self.shape, np.uint8)


def test_a_run_that_ended_early_is_shown_at_its_end(directory, tmp_path, monkeypatch):
    monkeypatch.setattr("iswarm_mj.output.offscreen.ArenaRenderer", NoiseRenderer)
    assert render(directory, None, SMALL_SHOT, tmp_path / "a.png") == 0
