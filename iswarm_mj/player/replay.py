"""A recorded run as one HTML file, which opens without a server and without this package."""

import html
import math
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from iswarm_mj.output.loading import SavedRun
from iswarm_mj.output.memory_vectors import recorded_vectors
from iswarm_mj.output.palette import Rgb
from iswarm_mj.output.schema import ARRAYS, Frames
from iswarm_mj.output.shapes import TRAIL_FRAMES
from iswarm_mj.output.trajectory import AREA, METRIC
from iswarm_mj.player import scene as arrays
from iswarm_mj.player.film import Film
from iswarm_mj.player.page import close_server, open_server
from iswarm_mj.player.view import SwarmView, aim, light
from iswarm_mj.player.widgets import spots
from iswarm_mj.utils.constraints import check
from iswarm_mj.utils.files import atomic_write, check_name

_LOADER, _RESET = "e.textContent=code", r'.replace(/[\w$]+\.useEnvironment\.set\([\w$]+\(\)\);/,"")'
"""Where viser's HTML starts its client, and what removes one statement from it: viser 1.1 restores its bright default
lights and environment map whenever a replay starts again (`resetScene` in FilePlayback.tsx)."""

MOST_STEPS = 200
"""Control steps of a replay by default at most, some 2 MB for 280 robots."""
Draw = Callable[[Any], Iterator[float]]
"""Draws what changes on a server, and yields how long each picture is shown [s]."""


def swarm_film(run: SavedRun, film: Film) -> tuple[Draw, list[tuple[str, Rgb]], int]:
    """Return what draws the first recorded world of a run, its legend, and the last step that is shown.

    Raises:
        ConfigError: the run has no such steps, no such colours, or nothing of that name to draw.
    """
    scene, known = run.scene, {*ARRAYS, *run.scene.memory_names}
    frames = Frames.from_arrays({k: v for k, v in run.arrays.items() if k in known or k.startswith((AREA, METRIC))})
    end = int(frames.step[-1])
    last = min(end, film.first + MOST_STEPS) if film.last is None else film.last
    check("last", last, f"a control step after the first one, up to {end}", film.first < last <= end)
    ways = arrays.ways_to_colour(scene, frames[:1])
    check("colour_by", film.colour_by, f"one of {', '.join(ways)}", film.colour_by in ways)
    drawn = ("links", "trails", *(vector.stem for vector in recorded_vectors(scene.memory)))
    for name in film.draw:
        check("draw", name, f"some of {', '.join(drawn)}", name in drawn)

    def draw(server: Any) -> Iterator[float]:
        aim(server.initial_camera, scene)
        view = SwarmView(server.scene, scene)
        view.by, view.shows, view.is_coarse = film.colour_by, set(film.draw), True
        each = film.frames_per_step
        for picture in range(round((last - film.first) * each) + 1):
            time = round(film.first + picture / each, 6)  # in control steps
            after = math.ceil(time)
            shown = [frames[k : k + 1] for k in range(max(0, after - TRAIL_FRAMES), after + 1)]
            view.show(shown, time - after + 1)
            yield 1 / (film.speed * each)

    return draw, arrays.legend(scene, film.colour_by, frames[film.first : last + 1].is_alive), last


def serialized(draw: Draw) -> Any:
    """Return viser's serializer of all that is drawn, whose `as_html` is a page and `serialize` the data alone."""
    server = open_server()
    try:
        server.gui.configure_theme(show_logo=False, show_share_button=False)
        light(server.scene)
        found = server.get_scene_serializer()
        for seconds in draw(server):
            found.insert_sleep(seconds)
        return found
    finally:
        close_server(server)


def page(draw: Draw, legend: list[tuple[str, Rgb]], title: str, dark: bool = False) -> str:
    """Return the HTML of a replay."""
    ink, paper = ("#eee", "#1e1e1e") if dark else ("#222", "#fff")
    about = f"""<style>
body {{ display: flex; flex-direction: column; }}
body {{ background: {paper}; color: {ink}; font: 16px system-ui, sans-serif; }}
#root {{ flex: 1; min-height: 0; }}
@media (max-aspect-ratio: 4/3) {{ #root {{ flex: 0 0 75vw; }} }}
</style>{spots(legend, title)}"""
    text = serialized(draw).as_html(dark_mode=dark)
    text = re.sub("<title>.*?</title>", lambda _: f"<title>{html.escape(title)}</title>", text, count=1)
    return text.replace(_LOADER, _LOADER + _RESET, 1).replace("<body>", f"<body>{about}", 1)


def write_replay(run: SavedRun, film: Film, out: Path) -> int:
    """Write the replay of a run, whole or not at all; return its last step.

    Raises:
        UserError: the run has no such steps, its arrays do not fit each other, or the file cannot be written.
    """
    check_name(out, ".html")
    with run.explained():
        draw, legend, last = swarm_film(run, film)
        text = page(draw, legend, film.title or f"{len(run.scene.is_alive)} robots, {run.path.name}", film.dark)
    with atomic_write(out) as part:
        part.write_text(text, encoding="utf-8")
    return last
