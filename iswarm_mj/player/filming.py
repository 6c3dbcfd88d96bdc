"""Frames of a recorded run, and checks of what a replay or a video shows of them."""

from iswarm_mj.output.legend import LINKS, TRAILS
from iswarm_mj.output.loading import SavedRun
from iswarm_mj.output.memory_vectors import recorded_vectors
from iswarm_mj.output.schema import ARRAYS, Frames
from iswarm_mj.output.trajectory import AREA, METRIC, Scene
from iswarm_mj.player.film import Film
from iswarm_mj.player.scene import ways_to_colour
from iswarm_mj.utils.constraints import check


def frames_of(run: SavedRun) -> Frames:
    """Return the frames of the first recorded world of a run."""
    known = {*ARRAYS, *run.scene.memory_names}
    of_task = (AREA, METRIC)
    arrays = run.arrays.items()
    return Frames.from_arrays(
        {name: a for name, a in arrays if name in known or name.startswith(of_task)}
    )


def check_names(film: Film, scene: Scene, frames: Frames) -> None:
    """Check what colours robots in a film, and what it draws.

    Raises:
        ConfigError: the run has no such colours, or nothing of that name to draw.
    """
    ways = ways_to_colour(scene, frames[:1])
    check("colour_by", film.colour_by, " or ".join(ways), film.colour_by in ways)
    drawable = (LINKS, TRAILS, *(vector.stem for vector in recorded_vectors(scene.memory)))
    for name in film.draw:
        check("draw", name, f"some of {', '.join(drawable)}", name in drawable)
