"""The statements of section 4.6.1 on evolutions (Fig. 14, Table 2), and on searches that the paper lacks.

All are predicted but four. What a dependent mutation does to a Boolean was chosen by the paper's number of swarms
without hop counts (`strategy.evolution.Operators.boolean_mutation`), and most of these fail: so many swarms fail, and
most of those that fail lost hop counts by chance, whatever their other parameters are, so that these are nearly equal
in swarms that clean the arena and in others.
"""

from iswarm_mj.experiments.analysis.findings import FITTED, NOT_IN_PAPER, PREDICTED, Claim

_WHERE = "section 4.6.1"
RISES = Claim(
    "The best fitness rises steadily from generation 1 to 35", f"{_WHERE}, Fig. 14(a)", "steady increase", PREDICTED
)
LEARNS = Claim(
    "The last 20 generations are fitter than the first 5", f"{_WHERE}, Fig. 14(a)", "yes, by the figure", PREDICTED
)
BEATS = Claim("The evolution beats random search at the same budget", NOT_IN_PAPER, "not studied", PREDICTED)
RIVAL = Claim("The evolution against CMA-ES at the same budget", NOT_IN_PAPER, "not studied", PREDICTED)
AS_FIT = Claim(
    "The fittest swarm of an evolution has the paper's fitness",
    f"{_WHERE}, Table 2",
    "7771 points, the fittest of 1200",
    PREDICTED,
)
SLOW = Claim(
    "No swarm cleans the whole arena in less than 250 steps",
    "section 4.6",
    "theoretical shortest finishing time of approximately 250 steps",
    PREDICTED,
)
MANY_FAIL = Claim("A high fraction of the swarms does not clean the whole arena", _WHERE, "525 of 1200, 43.8 %", FITTED)
COUNTED = Claim(
    "Swarms that clean the whole arena use hop counts, at least 90 % of them", _WHERE, "655 of 675, 97.0 %", PREDICTED
)
UNCOUNTED = Claim("Most swarms that do not clean it do not use them", _WHERE, "464 of 525, 88.4 %", FITTED)
EXCEPTIONS = Claim(
    "About 4 % of the swarms without hop counts clean the whole arena",
    _WHERE,
    "20 of 484, 4.1 %: 675 - 655 of 464 + 20",
    PREDICTED,
)
SCOUTS_LEVEL = Claim("The fraction of scouts is 0.16 in swarms that clean the arena", _WHERE, "0.16 ± 0.12", PREDICTED)
FORGET_LEVEL = Claim("p(vector-forget) is 0.28 in swarms that clean the arena", _WHERE, "0.28 ± 0.13", PREDICTED)
SCOUTS = Claim(
    "The fraction of scouts is equal in swarms that clean the arena and in others",
    _WHERE,
    "0.16 ± 0.12 and 0.16 ± 0.13",
    FITTED,
)
FORGET = Claim(
    "p(vector-forget) is equal in swarms that clean the arena and in others",
    _WHERE,
    "0.28 ± 0.13 and 0.29 ± 0.16",
    FITTED,
)
TRADE = Claim(
    "p(vector-forget) and the fraction of scouts are negatively correlated among the 250 fittest swarms of generations "
    "35 to 100",
    f"{_WHERE}, Fig. 14(b)",
    "strong negative correlation, no number given",
    PREDICTED,
)
DENSITY = Claim(
    "The density converges to 11.8 to 13.2 %", _WHERE, "11.8 % (280 robots) to 13.2 % (314 robots)", PREDICTED
)
SIGNALS = Claim(
    "Priority is signalled by loaded robots and not by scouts in the fittest swarms",
    f"{_WHERE}, Table 2",
    "both types",
    PREDICTED,
)
WEIGHTS = Claim(
    "weight-find-dump exceeds weight-find-dust in the fittest swarms", f"{_WHERE}, Table 2", "both types", PREDICTED
)
DISTANCES = Claim(
    "The fittest keep more distance between empty robots than from priority, and least when loaded",
    f"{_WHERE}, Table 2",
    "0.65/0.77, 0.40/0.41 and 0.25/0.27 sr",
    PREDICTED,
)
CLAIMS = (
    RISES,
    LEARNS,
    BEATS,
    RIVAL,
    AS_FIT,
    SLOW,
    MANY_FAIL,
    COUNTED,
    UNCOUNTED,
    EXCEPTIONS,
    SCOUTS_LEVEL,
    FORGET_LEVEL,
    SCOUTS,
    FORGET,
    TRADE,
    DENSITY,
    SIGNALS,
    WEIGHTS,
    DISTANCES,
)
