"""All results, the findings on them, the report, and the tables of README and docs."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from iswarm_mj.experiments.analysis.plots_of_searches import draw_fitness
from iswarm_mj.experiments.report.parts import Part, make
from iswarm_mj.experiments.report.results import GRASP, collect, topics_of, write_findings
from iswarm_mj.experiments.report.tables import Tables, check_name, new_texts
from iswarm_mj.experiments.report.writer import report
from iswarm_mj.experiments.runner.search import FIGURE
from iswarm_mj.experiments.studies.registry import EXPERIMENTS
from iswarm_mj.output.plot_trials import draw_figures
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.files import atomic_write, make_output_directory, remove
from iswarm_mj.utils.lock import locked


class Places(NamedTuple):
    """Where things are read and written."""

    results: Path
    """Directory of the parts."""
    out: Path
    """Directory where parts are made, a directory each, and of the report."""
    pages: Sequence[Path]
    """Markdown files with blocks of results."""
    beside: Path | None = None
    """Other results, whose verdicts stand beside these in the report."""


def chosen(parts: Mapping[str, Part], only: Sequence[str]) -> list[Part]:
    """Parts of these names, all if there are none.

    Raises:
        UserError: there is none of a name.
    """
    for name in only:
        if name not in parts:
            raise UserError(f"The part was {name!r}; there are {', '.join(parts)}: choose of these with `only`.")
    return [part for name, part in parts.items() if not only or name in only]


def listing(parts: Sequence[Part], results: Path, same_engine: bool = False) -> str:
    """What is there and what has to be made, a line each."""
    width = max(len(part.name) for part in parts)
    return "\n".join(f"{part.name:{width}}  {part.lacks(results, same_engine) or 'there'}" for part in parts)


def reproduce(parts: Sequence[Part], places: Places, again: bool = False, same_engine: bool = False) -> None:
    """Make the parts that are not there, then findings, tables and the report from all results.

    A part is made in a directory of its own, from which it can go on after an interruption, and its table, figures and
    best genomes are copied into the results when it is complete. A part that cannot be made, since its directory is
    damaged for example, is left out and named at the end.

    Args:
        parts: to be made.
        places: where.
        again: make all of them, from the beginning.
        same_engine: make those too that another engine computed.

    Raises:
        UserError: a page has a block that cannot be filled, something cannot be written, or a part was left out.
        SimulationFault: a run could not go on.
    """
    new_texts(places.pages, check_name)  # before anything takes hours
    make_output_directory(places.results, setting="results")
    with locked(places.out):
        _make(parts, places, again, same_engine)


def _make(parts: Sequence[Part], places: Places, again: bool, same_engine: bool) -> None:
    missing = []
    for part in parts:
        why = "again" if again else part.lacks(places.results, same_engine)
        print(f"{part.name}: {f'to be made, {why}' if why else 'there'}", flush=True)
        if why:
            missing.append(part)
    refused = {}
    for part, error in make(missing, places.out, again):
        if error is None:
            part.publish(places.out / part.name, places.results)
            print(f"{part.name}: made", flush=True)
        else:
            refused[part.name] = error
            print(f"{part.name}: not made, {error}", flush=True)
    rewrite(places, partial=True)
    report([places.results], places.out / "report.html", places.beside)
    if refused:
        why = "; ".join(f"{name} was not made ({error})" for name, error in refused.items())
        raise UserError(f"{why}; all other parts are there: make it anew with `only` and `again`")


def rewrite(places: Places, partial: bool = False) -> None:
    """Write the findings beside the tables, and the blocks of the pages, from the results that are there.

    Args:
        places: where.
        partial: leave blocks as they are for which there are no results yet.

    Raises:
        UserError: a block cannot be filled, or a file cannot be written; in the first case nothing is written.
    """
    topics = topics_of(collect([places.results]))
    texts = new_texts(places.pages, Tables(partial=partial).content)
    with locked(places.results):
        write_findings(topics)
    for path, text in texts.items():
        with atomic_write(path) as part:
            part.write_text(text, encoding="utf-8")
    print(f"findings in {places.results}" + "".join(f"\ntables in {path}" for path in texts))


def redraw(results: Path) -> list[Path]:
    """Draw the figures of all tables below a directory, each beside its table; return the paths of the PNG files.

    Drawings and pictures of single runs stay as they are, since tables do not have them. An SVG file is kept where one
    was before.

    Raises:
        UserError: there is no such directory, or a file cannot be written.
    """
    drawn, kept = [], set(results.glob("**/*.svg"))
    for name, result in collect([results]).used.items():
        out = result.path.parent
        if name == GRASP:
            drawn += draw_figures(result.rows, result.settings, out)
        elif name in EXPERIMENTS:
            drawn += EXPERIMENTS[name].draw(result.rows, out)
        else:
            draw_fitness(result.rows, result.settings["config"]["arena"]["n_dust"], out / FIGURE)
            drawn.append(out / f"{FIGURE}.png")
    for path in drawn:
        if (drawing := path.with_suffix(".svg")) not in kept:
            remove(drawing)
    return drawn
