"""Which readings agree with the paper: the design, and the support in made-up rows."""

from functools import cache

import pytest

from iswarm_mj.config.swarm import INTERPRETATIONS, SwarmConfig
from iswarm_mj.paper.analysis.statistics import Interval
from iswarm_mj.paper.studies import reading_combinations
from iswarm_mj.paper.studies.experiment import Plan, varied
from iswarm_mj.paper.studies.reading_combinations import (
    FACTORS,
    FIGURE_SETTINGS,
    NAMED_READINGS,
    NAMED_REPEATS,
    SINGLE_CHANGES,
    sample_combinations,
)
from iswarm_mj.paper.studies.reading_support import (
    Combination,
    accept_best,
    label_instead_of,
    support_of_factors,
)
from iswarm_mj.paper.studies.registry import EXPERIMENTS
from iswarm_mj.strategy.genome import PRESETS

N = 40


@cache
def listed():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(reading_combinations, "N_COMBINATIONS", N)
        return EXPERIMENTS["infer"].entries(Plan())


def test_every_label_comes_equally_often_and_is_a_setting_of_its_own():
    drawn = sample_combinations(60, 0)
    for name, levels in FACTORS.items():
        assert [sum(labels[name] == level for labels in drawn) for level in levels] == len(
            levels
        ) * [60 // len(levels)]
        configs = [varied(SwarmConfig(), values) for values in levels.values()]
        assert len(set(configs)) == len(levels) and SwarmConfig() in configs, name
    assert drawn != sample_combinations(60, 1) and drawn == sample_combinations(60, 0)


def test_each_combination_is_run_on_all_figures_and_both_types():
    sampled = [e for e in listed() if e.labels["reading"] is None]
    assert len(sampled) == N * len(FIGURE_SETTINGS) == N * 12
    assert len(listed()) - len(sampled) == (
        len(NAMED_READINGS) + len(SINGLE_CHANGES)
    ) * NAMED_REPEATS * len(FIGURE_SETTINGS)
    for entry in sampled[:24]:
        config = SwarmConfig()
        for name in FACTORS:
            config = varied(config, FACTORS[name][entry.labels[name]])
        assert entry.job.config == config
    types = {
        (e.job.genome, e.job.steps, e.job.stop_at) for e in sampled if e.labels["study"] == "types"
    }
    assert types == {(PRESETS[name], 800, None) for name in ("type1", "type2")}
    absent = {
        (e.job.genome.use_hop_count, e.job.stop_at, e.job.steps)
        for e in sampled
        if e.labels["setting"] == "without"
    }
    assert absent == {(False, 66, 1200)}


def test_the_paper_s_reading_is_run_with_each_other_value_alone_in_the_same_layouts():
    found = {}
    for entry in listed():
        if entry.labels["reading"] == "paper":
            found.setdefault(entry.labels["combination"], []).append(entry)
    plain, *changed = [found[place] for place in sorted(found, reverse=True)]
    assert (
        len(changed)
        == len(SINGLE_CHANGES)
        == len({one[0].job.config for one in changed} - {plain[0].job.config})
    )
    for one in changed:
        assert [e.job.seed for e in one] == [e.job.seed for e in plain]
        (told,) = [(name, one[0].labels[name]) for name in FACTORS if one[0].labels[name]]
        assert one[0].job.config == varied(INTERPRETATIONS["paper"], FACTORS[told[0]][told[1]])


@pytest.mark.parametrize(
    "low, counts, default, expected",
    [
        (0.4, {"a": 12, "b": 12, "c": 12}, "a", "c"),  # the largest share of those supported
        (0.4, {"a": 12, "b": 12, "c": 11}, "a", "b"),
        (0.4, {"a": 12, "b": 11, "c": 11}, "a", None),
        (0.4, {"a": 12, "b": 11, "c": 12}, "c", None),
        (0.4, {"a": 12}, "a", None),
        (0.34, {"a": 3, "b": 3}, "a", "b"),  # of three labels each has a third without support
        (0.32, {"a": 3, "b": 3}, "a", None),
    ],
)
def test_a_default_gives_way_to_what_is_supported_and_does_no_worse_alone(
    low, counts, default, expected
):
    shares = {
        "a": Interval(0.1, 0.05, 0.2),
        "b": Interval(0.5, low, 0.6),
        "c": Interval(0.6, 0.5, 0.7),
    }
    assert label_instead_of(default, shares, counts) == expected


def test_chances_are_corrected_for_the_number_of_factors_and_penalties_decide_between_equals():
    """Of 200, the ten that are accepted have one label of `stops`, and those of `drops` by
    halves."""
    usual = {name: next(iter(levels)) for name, levels in FACTORS.items()}
    of = {name: list(FACTORS[name]) for name in ("stops", "drops")}
    sample = [
        Combination(
            None,
            usual | {"stops": of["stops"][k % 2], "drops": of["drops"][k // 2 % 2]},
            [k % 2 == 0],
            k / 200,
        )
        for k in range(200)
    ]
    found = support_of_factors(
        [*sample, Combination("paper", dict.fromkeys(FACTORS), [True], 0.0, [1])]
    )
    assert found["stops"].p == pytest.approx(2 / 2**10) and found["drops"].p == pytest.approx(1)
    assert (
        found["stops"].adjusted_p == pytest.approx(len(FACTORS) * 2 / 2**10)
        and len(found["stops"].shares) == 2
    )
    near = [one._replace(penalty_error=abs(k - 10)) for k, one in enumerate(sample[:40])]
    assert [near.index(one) for one in accept_best(near).accepted] == [10, 8]
