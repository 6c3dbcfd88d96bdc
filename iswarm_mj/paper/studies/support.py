"""Support of readings by the paper's statements: approximate Bayesian computation by rejection.

Combinations of readings are drawn from a prior in which all labels of a factor are equally
probable. Those that reproduce the most of the statements that select are accepted; a label's share
among them is its posterior probability, given how many of these hold. The other statements are held
out.

Source: Pritchard et al. (1999), Mol. Biol. Evol. 16, 1791.
"""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.ticker import MaxNLocator

from iswarm_mj.output.palette import BLUE, DARK, GREEN
from iswarm_mj.output.plot_style import figure
from iswarm_mj.paper.analysis.findings import (
    NOT_COMPARABLE,
    NOT_IN_PAPER,
    PREDICTED,
    TOO_FEW,
    Finding,
    short,
)
from iswarm_mj.paper.analysis.findings import number as shown
from iswarm_mj.paper.analysis.judge import EQUAL
from iswarm_mj.paper.analysis.measures import (
    BEST,
    CLEAN,
    COLLISIONS,
    DENSE,
    MEASURES,
    PAPER_TIME,
    PENALTIES,
    SPARSEST,
    finished,
    values,
)
from iswarm_mj.paper.analysis.plots import ORANGE, PALE
from iswarm_mj.paper.analysis.statistics import Interval, even, holm, interval, share
from iswarm_mj.paper.studies.infer import DEFAULTS, FACTORS
from iswarm_mj.search.rows import Rows, by

ACCEPTED = 0.05
"""Share of the combinations that is accepted."""
LEAST_COMBINATIONS = 20
"""Of which this share can be accepted."""
SAME_PENALTY = 2.0
"""A penalty agrees within this factor."""
_NAMED_STYLES = tuple(zip((ORANGE, GREEN, DARK), ("-", (0, (3, 3)), (0, (1, 5))), strict=True))
"""Of lines that may lie upon each other, which all are seen then."""


class Combination(NamedTuple):
    """A combination of readings and what came of it."""

    reading: str | None
    """Name of a reading that is not part of the sample."""
    labels: Mapping[str, str | None]
    """By factors. A named reading has none; with one value changed, it has that one."""
    answers: Sequence[bool]
    """Which of the statements that select it reproduces."""
    penalty_error: float
    """Decides between combinations that reproduce equally many; the smaller, the better."""
    single: Sequence[int] = ()
    """How many of them single runs of each setting reproduce, by layouts."""
    held_out: Sequence[bool] = ()
    """Which of the other statements it reproduces."""

    @property
    def is_named(self) -> bool:
        """Whether it is a named reading as it is."""
        return self.reading is not None and not any(self.labels.values())


class Support(NamedTuple):
    """What the accepted combinations, and the paper's reading with one value changed, say of a factor, by labels."""

    shares: Mapping[str, Interval]
    """Of those accepted, with Wilson's interval."""
    p: float
    """That those accepted are drawn from the sample whatever their label."""
    adjusted: float
    """The same by Holm for the number of factors."""
    counts: Mapping[str, int]
    """Statements that select and `paper` reproduces with this label and all else unchanged, the
    default first."""
    more: Mapping[str, Interval]
    """How many more than with the default single runs reproduce: mean over layouts."""
    gives_way: str | None
    """Label to which the default gives way, if any."""


def answers(runs: Rows) -> tuple[dict[str, bool], dict[str, bool]]:
    """Which statements of section 4.6 hold for the medians of one set of runs: those that select,
    and those held out.

    Fig. 17 and the penalties in Table 2 select; Fig. 15 and the times of both types are held out.
    """
    groups = by(runs, "setting")
    middles = [
        {name: values(rows, measure) for name, rows in groups.items()} for measure in MEASURES
    ]
    time, dust, collisions, carriage = (
        {name: float(np.median(found)) if len(found) else math.inf for name, found in each.items()}
        for each in middles
    )
    reaches = {name: 2 * finished(rows) > len(rows) for name, rows in groups.items()}
    densities = sorted(
        {row["density"]: row["setting"] for row in runs if row["study"] == "density"}.items()
    )
    best, clean, sparse, dense = (
        {name for density, name in densities if low <= density <= high}
        for low, high in (BEST, CLEAN, (SPARSEST, SPARSEST), DENSE)
    )

    def is_best(measure: Mapping[str, float]) -> bool:
        return min((name for _, name in densities), key=measure.__getitem__) in best

    def agrees(name: str) -> bool:
        return reaches[name] and abs(time[name] / PAPER_TIME[name] - 1) <= EQUAL

    def penalty_agrees(name: str) -> bool:
        return 1 / SAME_PENALTY <= 0.05 * collisions[name] / PENALTIES[name] <= SAME_PENALTY

    one, two = time["type1"], time["type2"]
    selecting = {
        "Fastest at 0.1 to 0.15": is_best(time),
        "Fewest collisions at 0.1 to 0.15": is_best(collisions),
        "Shortest carriage at 0.1 to 0.15": is_best(carriage),
        "Slower above 0.2": min(time[name] for name in dense) > min(time[name] for name in best),
        "0.1 to 0.2 cleans": all(reaches[name] for name in clean),
        "0.05 does not clean": not any(reaches[name] for name in sparse),
        "Above 0.2 does not clean": not any(reaches[name] for name in dense),
        "Type 1 loses 9 points by collisions": penalty_agrees("type1"),
        "Type 2 loses 4 points by collisions": penalty_agrees("type2"),
    }
    held_out = {
        "Hop counts: faster": time["with"] < time["without"],
        "Hop counts: more dust": dust["with"] > dust["without"],
        "Hop counts: fewer collisions": collisions["with"] < collisions["without"],
        "Hop counts: shorter carriage": carriage["with"] < carriage["without"],
        "Type 1 takes 310 steps": agrees("type1"),
        "Type 2 takes 311 steps": agrees("type2"),
        "Both types take the same time": reaches["type1"]
        and reaches["type2"]
        and abs(one - two) <= EQUAL * (one + two) / 2,
    }
    return selecting, held_out


def penalty_error(runs: Rows) -> float:
    """Mean of |log(penalty / the paper's)| of both types by collisions; without any, as if they
    were one a robot."""
    groups = by(runs, "setting")
    found = [
        max(0.05, 0.05 * float(np.median(values(groups[name], COLLISIONS)))) / p
        for name, p in PENALTIES.items()
    ]
    return float(np.mean(np.abs(np.log(found))))


def combinations_of(rows: Rows) -> list[Combination]:
    """Combinations, named readings and the paper's with one value changed, with their answers, from
    the table."""
    listed = []
    for runs in by(rows, "combination").values():
        selecting, held_out = (list(each.values()) for each in answers(runs))
        single = [sum(answers(mine)[0].values()) for _, mine in sorted(by(runs, "repeat").items())]
        labels = {name: runs[0][name] for name in FACTORS}
        listed.append(
            Combination(
                runs[0]["reading"], labels, selecting, penalty_error(runs), single, held_out
            )
        )
    return listed


def sample_of(every: Sequence[Combination]) -> tuple[list[Combination], list[Combination]]:
    """The combinations that were drawn, and the accepted of them: the best share `ACCEPTED`, at
    least one."""
    sample = [one for one in every if one.reading is None]
    ranking = sorted(sample, key=lambda c: (-sum(c.answers), c.penalty_error))
    return sample, ranking[: max(1, round(ACCEPTED * len(sample)))]


def supports(every: Sequence[Combination]) -> dict[str, Support]:
    """Support of the labels of all factors; labels that the sample lacks are left out."""
    (sample, kept), mine = sample_of(every), [one for one in every if one.reading == "paper"]
    (plain,) = (one for one in mine if one.is_named)
    tried = {name: Counter(c.labels[name] for c in sample) for name in FACTORS}
    taken = {name: Counter(c.labels[name] for c in kept) for name in FACTORS}
    labels = {
        name: [label for label in levels if tried[name][label]] for name, levels in FACTORS.items()
    }
    raw = [
        even(
            [taken[name][label] for label in mine],
            [tried[name][label] / len(sample) for label in mine],
        )
        for name, mine in labels.items()
    ]
    found = {}
    for name, p, adjusted in zip(FACTORS, raw, holm(raw), strict=True):
        default, others = (
            DEFAULTS[name],
            {label: one for one in mine if (label := one.labels[name])},
        )
        shares = {label: share(taken[name][label], len(kept)) for label in labels[name]}
        counts = {label: sum(one.answers) for label, one in ({default: plain} | others).items()}
        more = {
            label: interval(np.subtract(one.single, plain.single)) for label, one in others.items()
        }
        found[name] = Support(shares, p, adjusted, counts, more, gives_way(default, shares, counts))
    return found


def gives_way(
    default: str, shares: Mapping[str, Interval], counts: Mapping[str, int]
) -> str | None:
    """Label to which a default gives way, if any: the one with the largest share of those that are
    supported.

    A label needs an interval of its share above that of all without support, and as many statements
    alone as the default.
    """
    able = [
        label
        for label, share in shares.items()
        if label != default
        and share.low > 1 / len(shares)
        and counts.get(label, -1) >= counts[default]
    ]
    return max(able, key=lambda label: shares[label].estimate, default=None)


def findings(rows: Rows) -> list[Finding]:
    """How many statements are reproduced, by how many combinations, and which choices they
    support."""
    best = Finding(
        "Combinations of readings that reproduce the paper's statements",
        "section 4.6",
        "all",
        PREDICTED,
    )
    if not rows:
        return [best]
    every = combinations_of(rows)
    (sample, kept), counts = sample_of(every), [sum(c.answers) for c in every if c.reading is None]
    most, total, others = max(counts), len(every[0].answers), len(every[0].held_out)
    said = "; ".join(
        f"{c.reading} {sum(c.answers)} of {total}, and of those held out {sum(c.held_out)} of {others}"
        for c in every
        if c.is_named
    )
    apart = [float(np.mean([sum(c.held_out) for c in group])) for group in (kept, sample)]
    rule = (
        f"{len(sample)} combinations drawn from {len(FACTORS)} readings; the {len(kept)} that miss the fewest "
        "statements that select are accepted (approximate Bayesian computation by rejection); of equals those nearer "
        "in the penalties of both types"
    )
    ours = f"at most {most} of {total}, by {counts.count(most)}; median {shown(float(np.median(counts)))}; {said}"
    ours += f"; held out, mean of {others}: accepted {shown(apart[0])}, all {shown(apart[1])}"
    verdict = "" if len(sample) >= LEAST_COMBINATIONS else TOO_FEW
    listed = [best._replace(ours=ours, statistics=rule, verdict=verdict)]
    for name, one in supports(every).items():
        text = "; ".join(f"{label}: {short(share, '%')}" for label, share in one.shares.items())
        if one.gives_way:
            text += f"; by the rule, {DEFAULTS[name]} gives way to {one.gives_way}"
        prior = (
            f"share of the accepted combinations, of which {shown(100 / len(FACTORS[name]))} % without any support; "
            f"Wilson; exact multinomial p = {shown(one.p, 2)}, {shown(one.adjusted, 2)} by Holm for {len(FACTORS)} "
            f"readings; of `paper` with one value hold, of those that select: "
            f"{', '.join(f'{label} {n}' for label, n in one.counts.items())}"
        )
        claim = f"Support of {name.replace('_', ' ')}"
        listed.append(
            Finding(claim, NOT_IN_PAPER, "not stated", NOT_COMPARABLE, text, prior, verdict)
        )
    return listed


def draw(rows: Rows, path: Path) -> None:
    """Draw three panels: statements per combination, each statement's share, the support of each
    choice."""
    every = combinations_of(rows)
    (sample, kept), named = sample_of(every), [c for c in every if c.is_named]
    shares = {name: one.shares for name, one in supports(every).items()}
    asked = [text for each in answers(by(rows, "combination")[0]) for text in each]
    caption = (
        f"n = {len(sample)} combinations; the {len(kept)} that reproduce most statements that select are accepted.\n"
        "Intervals: Wilson's, at 95 %, not corrected for the number of choices."
    )
    height = max(4.0, 0.17 * (sum(map(len, shares.values())) + len(shares)))
    with figure(path, columns=3, size=(4.6, height), caption=caption) as (left, middle, right):
        counts, total = Counter(sum(c.answers) for c in sample), len(sample[0].answers)
        left.bar(list(counts), list(counts.values()), color=PALE, edgecolor=BLUE, linewidth=0.8)
        left.xaxis.set_major_locator(MaxNLocator(integer=True))
        left.set(xlabel=f"statements that select reproduced, of {total}", ylabel="combinations")
        place = np.arange(len(asked))[::-1]
        middle.axhline(len(asked) - total - 0.5, color="#999999", linewidth=1)
        for group, shift, hue in ((sample, 0.2, PALE), (kept, -0.2, BLUE)):
            middle.barh(
                place + shift,
                np.mean([[*c.answers, *c.held_out] for c in group], axis=0),
                0.4,
                color=hue,
            )
        for k, ((hue, dashes), one) in enumerate(zip(_NAMED_STYLES, named, strict=False)):
            left.axvline(
                sum(one.answers),
                color=hue,
                linestyle=dashes,
                linewidth=2,
                label=f"reading {one.reading}",
            )
            holds = np.array([*one.answers, *one.held_out], bool)
            middle.plot(
                np.full(holds.sum(), 1.06 + 0.07 * k), place[holds], "o", color=hue, markersize=4.5
            )
        left.legend(loc="upper left")
        middle.set_yticks(place, asked)
        label = "share that reproduces it;\ndots: readings of (a) that do"
        middle.set(xlim=(0, 1.08 + 0.07 * len(named)), xlabel=label)
        middle.set_xticks(np.linspace(0, 1, 6))
        places, texts, at = [], [], 0.0
        for factor, labels in shares.items():
            top, prior = at, 1 / len(labels)
            for label, (estimate, low, high) in labels.items():
                at -= 1
                hue = ORANGE if low > prior else BLUE if high < prior else DARK
                right.errorbar(
                    estimate,
                    at,
                    xerr=[[estimate - low], [high - estimate]],
                    fmt="o",
                    color=hue,
                    ms=4,
                )
                places.append(at)
                texts.append(f"{factor.replace('_', ' ')}: {label}")
            right.plot([prior] * 2, [top - 0.6, at - 0.4], color="#999999", linewidth=1)
            at -= 0.6
        right.set_yticks(places, texts, fontsize=7.5)
        right.set(
            xlim=(0, 1),
            xlabel="share of the accepted combinations;\n95 % interval; grey: without any support",
        )
        right.grid(axis="y", visible=False)
        titles = (
            f"(a) {len(sample)} combinations",
            "(b) light: all, dark: accepted; above the line: select",
            "(c) orange: supported, blue: contradicted",
        )
        for axes, title in zip((left, middle, right), titles, strict=True):
            axes.set_title(title, loc="left", fontsize=9)
