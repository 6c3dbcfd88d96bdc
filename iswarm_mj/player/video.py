"""Videos of recorded runs: the pictures of `painter`, encoded."""

import math
from collections.abc import Iterator
from pathlib import Path

from iswarm_mj.output.legend import BALLS, TRAILS
from iswarm_mj.output.loading import SavedRun
from iswarm_mj.output.palette import Rgb
from iswarm_mj.output.schema import Frames
from iswarm_mj.output.shapes import TRAIL_FRAMES
from iswarm_mj.output.trajectory import METRIC, Arrays, Scene
from iswarm_mj.output.video import SUFFIXES, Clip, Picture, encode
from iswarm_mj.player.film import Film
from iswarm_mj.player.filming import check_names, frames_of
from iswarm_mj.player.painter import Look, Painter
from iswarm_mj.player.scene import legend
from iswarm_mj.utils.constraints import check
from iswarm_mj.utils.files import atomic_write, check_name, make_output_directory
from iswarm_mj.utils.progress import Progress

MAX_RATE = 60.0
"""Maximum number of pictures per second."""


def write_video(
    run: SavedRun,
    film: Film,
    out: Path,
    *,
    camera: str = "oblique",
    size: tuple[int, int] = (1280, 720),
    has_legend: bool = True,
) -> int:
    """Write a video of the first recorded world of a run, and return its last step.

    It is written whole or not at all. Robots move straight between two steps.

    Args:
        run: a recorded run.
        film: part of the run, and how it is shown; by default up to the end of the run.
        out: the file to write, ending in .mp4, .gif or .webp.
        camera: above or oblique.
        size: width and height, even numbers [pixels].
        has_legend: explain the colours.

    Raises:
        UserError: the run has no such steps, colours or lines, its arrays do not fit each other, or
            ffmpeg could not write the file.
    """
    check_name(out, *SUFFIXES)
    rate = film.speed * film.frames_per_step
    allowed = f"at most {MAX_RATE:g} pictures per second with `frames_per_step`"
    check("speed", film.speed, allowed, rate <= MAX_RATE)

    with run.explained():
        frames = frames_of(run)
        end = int(frames.step[-1])
        last = end if film.last is None else film.last
        constraint = f"a control step after the first one, up to {end}"
        check("last", last, constraint, film.first < last <= end)
        check_names(film, run.scene, frames)
        shown = frames[film.first : last + 1]
        entries = video_legend(run.scene, film, shown) if has_legend else []
        look = Look(
            camera=camera,
            size=size,
            colour_by=film.colour_by,
            draw=tuple(film.draw),
            legend=entries,
            n_caption_lines=len(_caption(film, run.arrays, 0)),
            is_dark=film.dark,
        )
        painter = Painter(run.scene, look)

    times = _times(film, last)
    make_output_directory(out.parent, given=out)
    bar = Progress(len(times), "frame", out.stem)
    # Outside of `explained`, since errors of the encoder are not due to the arrays.
    with atomic_write(out) as part, bar:
        samples = _pictures(
            painter, run, frames, film, [times[0], times[len(times) // 2], times[-1]]
        )
        pictures = _counted(_pictures(painter, run, frames, film, times), bar)
        encode(Clip(pictures, size, rate), part, out.suffix, samples)
    return last


def video_legend(scene: Scene, film: Film, shown: Frames) -> list[tuple[str, Rgb | None]]:
    """Return the legend of a video: robots, balls, lines and areas.

    Args:
        scene: constants of the world.
        film: what is shown, and how.
        shown: frames that are shown.
    """
    entries: list[tuple[str, Rgb | None]] = []
    for heading, colours in legend(scene, film.colour_by, film.draw, shown.is_alive):
        kind = "ball " if heading == BALLS else ""
        entries += [(f"{kind}{label}", colour) for label, colour in colours]
    if len(scene.ball_radius):
        entries.append(("balls are drawn enlarged", None))
    return entries


def _times(film: Film, last: int) -> list[float]:
    """Return the times of the pictures, in control steps."""
    n_pictures = round((last - film.first) * film.frames_per_step) + 1
    times = [film.first + picture / film.frames_per_step for picture in range(n_pictures)]
    return [min(round(time, 6), last) for time in times]


def _pictures(
    painter: Painter, run: SavedRun, frames: Frames, film: Film, times: list[float]
) -> Iterator[Picture]:
    """Yield pictures with their captions at some times, in control steps."""
    n_before = TRAIL_FRAMES if TRAILS in film.draw else 1
    for time in times:
        step_after = math.ceil(time)
        with run.explained():
            first = max(0, step_after - n_before)
            past = [frames[step : step + 1] for step in range(first, step_after + 1)]
            caption = _caption(film, run.arrays, int(time))
            picture = painter.paint(past, share=time - step_after + 1, caption=caption)
        yield picture


def _counted(pictures: Iterator[Picture], bar: Progress) -> Iterator[Picture]:
    """Yield pictures, and count each on a progress bar when it has been used."""
    for picture in pictures:
        yield picture
        bar.update()


def _caption(film: Film, frames: Arrays, step: int) -> list[str]:
    """Return the lines of a caption: title, step, and metrics of the task or else deliveries."""
    lines = [film.title] if film.title else []
    lines.append(f"step {step}")
    metrics = frames["scene_metric_names"].tolist()
    if metrics:
        lines += [f"{name} {frames[METRIC + name][step]:.3g}" for name in metrics]
    else:
        n_balls = frames["ball_state"].shape[1]
        lines.append(f"{frames['delivered'][step]} of {n_balls} balls delivered")
    return lines
