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
    """A part of the report: statements, figures of ours, what the paper's figure shows, commands."""

    title: str
    findings: Sequence[Finding]
    pictures: Sequence[Picture]
    paper: str
    """What the paper's figure shows; empty without one."""
    commands: Sequence[str]


PAPER_FIGURES = {
    "grasp": (
        "Figs. 8 and 9 plot the means of five grasp voltages against the radius, 15 to 25 µm: between 20 and "
        "30 V at 10 % RH, higher at 30 and 50 %, without a trend along the radius. Fig. 11 shows a release at "
        "about 5 µm, which took 37 to 47 V; Fig. 10 a ball of 15 µm that melted to the tool at 70 V."
    ),
    "evolution": (
        "Fig. 14(a) plots the fitness of 1200 swarms against 120 generations, with a dashed line at 2860, the "
        "most without the last ball; the best rise until generation 35; the fittest two types have 7771 and "
        "7766 points. Fig. 14(b) plots p(vector-forget) against the fraction of scouts for the 250 fittest "
        "swarms of generations 35 to 100, along falling lines."
    ),
    "hop-count": (
        "Fig. 15 has a pair of bars in each of four panels, with and without hop counts: time, dust removed, "
        "collisions, length of carriage; medians and third quartiles of 12 runs. The text gives no numbers."
    ),
    "types": (
        "Fig. 16 is a pair of screenshots from above: robots as red boxes, loaded ones blue, two blue dust "
        "areas, the yellow dump between them. In type 2, with more scouts, empty robots gather around the "
        "dust areas; type 1 builds several sub-swarms that are narrowly connected."
    ),
    "density": (
        "Fig. 17 has a bar for each density from 0.05 to 0.4 in each of four panels: time, dust removed, "
        "collisions per robot, mean carriage; medians and third quartiles of 6 runs. Lowest between 0.1 and "
        "0.15."
    ),
}

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
