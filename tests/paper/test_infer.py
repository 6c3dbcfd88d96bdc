"""Which readings agree with the paper: the design of the study, and the support in made-up rows."""

import pytest

from iswarm_mj.config.swarm import INTERPRETATIONS, SwarmConfig
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
from iswarm_mj.search.rows import by
from iswarm_mj.strategy.genome import PRESETS
from iswarm_mj.utils.intervals import Interval

N_COMBINATIONS = 40


def config_of(labels):
    """Return the configuration that labels of all factors describe."""
    config = SwarmConfig()
    for name, levels in FACTORS.items():
        config = varied(config, levels[labels[name]])
    return config


class TestDesign:
    @pytest.mark.parametrize("name", FACTORS)
    def test_every_label_comes_equally_often(self, name):
        drawn = [labels[name] for labels in sample_combinations(60, 0)]
        for level in FACTORS[name]:
            assert drawn.count(level) == 60 // len(FACTORS[name])

    @pytest.mark.parametrize("name", FACTORS)
    def test_every_label_is_a_setting_of_its_own(self, name):
        configs = {varied(SwarmConfig(), values) for values in FACTORS[name].values()}
        assert len(configs) == len(FACTORS[name])
        assert SwarmConfig() in configs

    def test_it_depends_on_the_seed(self):
        assert sample_combinations(60, 0) == sample_combinations(60, 0)
        assert sample_combinations(60, 0) != sample_combinations(60, 1)


@pytest.fixture(scope="module")
def entries():
    """Return the runs of the study, with fewer combinations of readings."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(reading_combinations, "N_COMBINATIONS", N_COMBINATIONS)
        return EXPERIMENTS["infer"].entries(Plan())


class TestRuns:
    @pytest.fixture
    def sampled(self, entries):
        """Return the runs of combinations that were drawn."""
        return [entry for entry in entries if entry.labels["reading"] is None]

    def test_each_combination_is_run_on_all_figures_and_both_types(self, entries, sampled):
        assert len(FIGURE_SETTINGS) == 12
        assert len(sampled) == N_COMBINATIONS * len(FIGURE_SETTINGS)
        n_named = (len(NAMED_READINGS) + len(SINGLE_CHANGES)) * NAMED_REPEATS
        assert len(entries) == len(sampled) + n_named * len(FIGURE_SETTINGS)

    def test_labels_are_those_of_the_configuration(self, sampled):
        for entry in sampled[:24]:
            assert entry.job.config == config_of(entry.labels)

    def test_types_are_run_to_the_end(self, sampled):
        runs = set()
        for labels, job in sampled:
            if labels["study"] == "types":
                runs.add((job.genome, job.steps, job.stop_at))
        assert runs == {(PRESETS["type1"], 800, None), (PRESETS["type2"], 800, None)}

    def test_runs_without_hop_counts_are_longer_and_have_a_goal(self, sampled):
        runs = set()
        for labels, job in sampled:
            if labels["setting"] == "without":
                runs.add((job.genome.use_hop_count, job.steps, job.stop_at))
        assert runs == {(False, 1200, 66)}

    def test_the_paper_s_reading_is_run_with_each_other_value_alone(self, entries):
        """All have the same layouts."""
        of_paper = [
            {**labels, "job": job} for labels, job in entries if labels["reading"] == "paper"
        ]
        groups = by(of_paper, "combination")
        plain, *changed = (groups[number] for number in sorted(groups, reverse=True))
        seeds = [row["job"].seed for row in plain]
        configs = {plain[0]["job"].config}
        for rows in changed:
            assert [row["job"].seed for row in rows] == seeds
            (name,) = (name for name in FACTORS if rows[0][name])
            config = rows[0]["job"].config
            assert config == varied(INTERPRETATIONS["paper"], FACTORS[name][rows[0][name]])
            configs.add(config)
        assert len(changed) == len(SINGLE_CHANGES) == len(configs) - 1


@pytest.mark.parametrize(
    ("low", "counts", "default", "expected"),
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


@pytest.fixture
def sample():
    """Return 200 combinations, of which ten are accepted.

    Every second one answers as the paper does, and errors grow from one to the next. Those that are
    accepted have one label of `stops`, and each label of `drops` in half of them.
    """
    first_levels = {name: next(iter(levels)) for name, levels in FACTORS.items()}
    stops = list(FACTORS["stops"])
    drops = list(FACTORS["drops"])
    combinations = []
    for number in range(200):
        labels = {
            **first_levels,
            "stops": stops[number % 2],
            "drops": drops[number // 2 % 2],
        }
        answers = [number % 2 == 0]
        combinations.append(Combination(None, labels, answers, number / 200))
    return combinations


def test_chances_are_corrected_for_the_number_of_factors(sample):
    """Ten draws of one label of two have a chance of 2 / 2^10."""
    named = Combination("paper", dict.fromkeys(FACTORS), [True], 0.0, [1])
    support_of = support_of_factors([*sample, named])
    assert support_of["stops"].p == pytest.approx(2 / 2**10)
    assert support_of["stops"].adjusted_p == pytest.approx(len(FACTORS) * 2 / 2**10)
    assert len(support_of["stops"].shares) == 2
    assert support_of["drops"].p == pytest.approx(1)


def test_penalties_decide_between_combinations_with_equal_answers(sample):
    combinations = []
    for number, combination in enumerate(sample[:40]):
        combinations.append(combination._replace(penalty_error=abs(number - 10)))
    accepted = accept_best(combinations).accepted
    assert [combinations.index(combination) for combination in accepted] == [10, 8]
