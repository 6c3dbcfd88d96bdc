"""Sections of the report: statements of the paper's sections 3.2 and 4.6, what results say on them, and figures."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from iswarm_mj.experiments.analysis import evolution_figures
from iswarm_mj.experiments.analysis.findings import Finding
from iswarm_mj.experiments.report.reproduction import command
from iswarm_mj.experiments.report.results import Results, files_in
from iswarm_mj.experiments.report.statements import EVOLUTION, GRASP, SEARCHES, Topic, topics_of
from iswarm_mj.experiments.studies.registry import EXPERIMENTS
from iswarm_mj.output.plot_trials import draw_figures


class Picture(NamedTuple):
    """A figure or a video of ours."""

    path: Path
    caption: str


class Section(NamedTuple):
    """A part of the report: statements, figures of ours, what the paper says of its figure, commands."""

    title: str
    findings: Sequence[Finding]
    pictures: Sequence[Picture]
    paper: str
    """What the paper says of its figure; empty without one."""
    commands: Sequence[str]


PAPER_FIGURES = {
    "grasp": (
        "Figs. 8 and 9 plot the averages of five grasp voltages against the radius, at 10 % RH and at 30 and 50 %. By "
        "the text they range from 20 to 30 V at 10 %, which is optimal, and the radius does not really influence "
        "them. Fig. 10 has a ball, of 15 µm by the text, that melted to the tool at 70 V; Fig. 11 a release from "
        "about 5 µm, which by the text takes 37 to 47 V."
    ),
    "evolution": (
        "Fig. 14(a) has the absolute fitness of 1200 runs in 120 generations, with a dashed line at the most that a "
        "swarm achieves without removing all dust, 2860 points. By the text the best rise steadily between "
        "generations 1 and 35; the fittest of the two types have 7771 and 7766 points (Table 2). Fig. 14(b) has "
        "p(vector-forget) and the fraction of scouts of the 250 fittest swarms between generations 35 and 100, with "
        "two dashed lines that indicate a negative correlation."
    ),
    "hop-count": (
        "Fig. 15 compares runs with and without hop counts: (a) how quickly the goal is achieved, (b) how much dust "
        "is removed, (c) how many collisions happen, (d) on how short a way dust is carried; medians and third "
        "quartiles, 12 runs a bar. The text gives no numbers."
    ),
    "types": (
        "Fig. 16 has a screenshot of each type. By its caption type 2 shows a more intensive aggregation of empty "
        "robots around the dust areas, and type 1 builds several sub-swarms that are narrowly connected. Colours by "
        "the caption of Fig. 12: empty robots are red boxes, loaded ones blue; dust areas are blue, the dump is "
        "yellow."
    ),
    "density": (
        "Fig. 17 has (a) the time, (b) the cleaning, (c) collisions per robot and (d) the mean carriage at densities "
        "from 0.05 to 0.4; medians and third quartiles, 6 runs a bar. By its caption (a), (c) and (d) are lowest "
        "between 0.1 and 0.15, and swarms between 0.1 and 0.2 cleaned the whole arena."
    ),
}
"""What the paper's text and captions say of its figures, which are not at hand themselves."""

CAPTIONS = {
    "grasp_voltage": "Grasp voltages at 10 % RH",
    "grasp_voltage_humidity": "Grasp voltages at all humidities",
    "release_voltage": "Release voltages",
    "no_contact": "Attempts without contact",
    "evolution_paper": "Fitness in the paper's evolution",
    "evolution_random": "Fitness in random search",
    "evolution_cmaes": "Fitness in CMA-ES",
    "trade": "Forgetting and scouts among the 250 fittest, generations 35 to 100",
    "traits": "Means of the last 20 generations and correlations: dots are evolutions or searches, lines medians",
    "hop_count": "With and without hop counts: bars to the median, lines to the third quartile, dots are runs",
    "density": "Densities: bars to the median, lines to the third quartile, dots are runs",
    "types": "All types: dots are runs, lines medians",
    "sensitivity": "Each choice on its own against the default: orange intervals lie above zero, blue ones below",
    "robustness": "Failed robots: lines through the medians, bands between the quartiles, dots are runs",
    "time_step": "Physics steps a second: lines through the medians, bands between the quartiles, dots are runs",
    "message_time": "Messages that take time: bars to the median, lines to the third quartile, dots are runs",
}

COMMANDS = {
    "grasp": "iswarm grasp --out runs/grasp",
    "paper": "iswarm evolve --out runs/evolve",
    "random": "iswarm evolve --method random --out runs/evolve-random",
    "cmaes": "iswarm evolve --method cmaes --out runs/evolve-cmaes",
}


def sections_of(results: Results, figures: Path) -> list[Section]:
    """All sections, in the order of the paper; figures are drawn into the directory `figures`."""
    return [_section(topic, results, figures) for topic in topics_of(results)]


def _section(topic: Topic, results: Results, figures: Path) -> Section:
    """Section of a topic: its figures, and the commands that make its tables."""
    name, title, found, tables = topic
    pictures: list[Picture] = []
    commands = [command(result) for result in tables]
    if name == GRASP:
        pictures = [p for result in tables for p in _pictures(draw_figures(result.rows, result.settings, figures))]
        commands = commands or [COMMANDS[GRASP]]
    elif name == EVOLUTION:
        searches = {result.settings["method"]: (result.rows, result.settings) for result in tables}
        drawn = [evolution_figures.draw_search(*search, figures) for search in searches.values()]
        drawn.append(evolution_figures.draw_traits(searches, figures))
        pictures = _pictures([path for paths in drawn for path in paths])
        commands = [_search_command(results, method) for method in SEARCHES]
    elif name in EXPERIMENTS:
        commands = commands or [f"iswarm experiment {name}"]
        for result in tables:
            title += ": the quick version, with few and short runs" if result.settings["quick"] else ""
            pictures = _pictures(EXPERIMENTS[name].draw(result.rows, figures))
            if name == "types":
                pictures = _at_run_time(result.path.parent) + pictures
    return Section(title, found, pictures, PAPER_FIGURES.get(name, ""), commands)


def _search_command(results: Results, method: str) -> str:
    result = results.searches.get(method)
    return command(result) if result else COMMANDS[method]


def _pictures(paths: Sequence[Path]) -> list[Picture]:
    return [Picture(path, CAPTIONS.get(path.stem, path.stem.replace("_", " "))) for path in paths]


def _at_run_time(directory: Path) -> list[Picture]:
    """Drawings, pictures and videos that the experiment on types left in its directory."""
    captions = (
        ("type*[0-9].png", "drawn from the trajectory: vectors that robots follow in their colours, links grey"),
        ("type*_mujoco.png", "by MuJoCo's renderer, balls 15 times enlarged"),
        ("type*.mp4", "video, 12 control steps a second"),
    )
    found = []
    for pattern, caption in captions:
        for path in files_in(directory, pattern):
            found.append(Picture(path, f"{path.stem.split('_')[0].replace('type', 'Type ')}, {caption}"))
    return found
