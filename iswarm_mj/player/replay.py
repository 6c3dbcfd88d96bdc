"""A recorded run as one HTML file, which opens without a server and without this package."""

import html
import math
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

from iswarm_mj.output.legend import Group
from iswarm_mj.output.loading import SavedRun
from iswarm_mj.output.shapes import TRAIL_FRAMES
from iswarm_mj.player.film import Film
from iswarm_mj.player.filming import check_names, frames_of
from iswarm_mj.player.page import close_server, open_server
from iswarm_mj.player.scene import legend
from iswarm_mj.player.view import SwarmView, aim, light
from iswarm_mj.player.widgets import spots
from iswarm_mj.utils.constraints import check
from iswarm_mj.utils.files import atomic_write, check_name

_CLIENT_STARTS = "e.textContent=code"
"""Statement of viser's HTML that starts its client."""
_WITHOUT_RESET = r'.replace(/[\w$]+\.useEnvironment\.set\([\w$]+\(\)\);/,"")'
"""Expression that removes one statement from the client: viser 1.1 restores its bright default
lights and environment map whenever a replay starts again (`resetScene` in FilePlayback.tsx)."""

MOST_STEPS = 200
"""Control steps of a replay by default at most, some 2 MB for 280 robots."""
Draw = Callable[[Any], Iterator[float]]
"""Function that draws what changes on a server, and yields how long each picture is shown [s]."""


class SwarmFilm(NamedTuple):
    """A film of a run that fits the run."""

    draw: Draw
    """Draws the first recorded world."""
    legend: list[Group]
    """Labels and colours."""
    last: int
    """Last control step that is shown."""


def swarm_film(run: SavedRun, film: Film) -> SwarmFilm:
    """Return what draws the first recorded world of a run, its legend, and the last step shown.

    Raises:
        ConfigError: the run has no such steps, no such colours, or nothing of that name to draw.
    """
    scene = run.scene
    frames = frames_of(run)
    last = _last_step(film, end=int(frames.step[-1]))
    check_names(film, scene, frames)

    def draw(server: Any) -> Iterator[float]:
        aim(server.initial_camera, scene)
        view = SwarmView(server.scene, scene)
        view.colour_by = film.colour_by
        view.shows = set(film.draw)
        view.is_coarse = True
        pictures_per_step = film.frames_per_step
        n_pictures = round((last - film.first) * pictures_per_step) + 1
        for picture in range(n_pictures):
            time = round(film.first + picture / pictures_per_step, 6)  # in control steps
            step_after = math.ceil(time)
            first_of_trails = max(0, step_after - TRAIL_FRAMES)
            past = [frames[step : step + 1] for step in range(first_of_trails, step_after + 1)]
            view.show(past, share=time - step_after + 1)
            yield 1 / (film.speed * pictures_per_step)

    is_alive = frames[film.first : last + 1].is_alive
    return SwarmFilm(draw, legend(scene, film.colour_by, film.draw, is_alive), last)


def _last_step(film: Film, end: int) -> int:
    """Return the last control step of a film of a run that ends with a step.

    Raises:
        ConfigError: the run has no such steps.
    """
    last = film.last
    if last is None:
        last = min(end, film.first + MOST_STEPS)
    constraint = f"a control step after the first one, up to {end}"
    check("last", last, constraint, film.first < last <= end)
    return last


def serialized(draw: Draw) -> Any:
    """Return viser's serializer of all that is drawn.

    Its `as_html` returns a page, and `serialize` the data alone.
    """
    server = open_server()
    try:
        server.gui.configure_theme(show_logo=False, show_share_button=False)
        light(server.scene)
        serializer = server.get_scene_serializer()
        for seconds in draw(server):
            serializer.insert_sleep(seconds)
        return serializer
    finally:
        close_server(server)


def page(draw: Draw, legend: list[Group], title: str, *, dark: bool = False) -> str:
    """Return the HTML of a replay."""
    ink, paper = ("#eee", "#1e1e1e") if dark else ("#222", "#fff")
    about = f"""<style>
body {{ display: flex; flex-direction: column; }}
body {{ background: {paper}; color: {ink}; font: 16px system-ui, sans-serif; }}
#root {{ flex: 1; min-height: 0; }}
@media (max-aspect-ratio: 4/3) {{ #root {{ flex: 0 0 75vw; }} }}
</style>{spots(legend, title)}"""
    text = serialized(draw).as_html(dark_mode=dark)

    # The title is text, whatever characters it has.
    title_element = f"<title>{html.escape(title)}</title>"
    text = re.sub("<title>.*?</title>", lambda _: title_element, text, count=1)
    text = text.replace(_CLIENT_STARTS, _CLIENT_STARTS + _WITHOUT_RESET, 1)
    return text.replace("<body>", f"<body>{about}", 1)


def write_replay(run: SavedRun, film: Film, out: Path) -> int:
    """Write the replay of a run, whole or not at all; return its last step.

    Raises:
        UserError: the run has no such steps, its arrays do not fit each other, or the file cannot
            be written.
    """
    check_name(out, ".html")
    with run.explained():
        of_run = swarm_film(run, film)
        title = film.title or f"{len(run.scene.is_alive)} robots, {run.path.name}"
        text = page(of_run.draw, of_run.legend, title, dark=film.dark)
    with atomic_write(out) as part:
        part.write_text(text, encoding="utf-8")
    return of_run.last
