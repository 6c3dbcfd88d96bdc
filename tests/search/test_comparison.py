"""Comparisons of worlds: what is paired, how unfinished and failed worlds count, what is said."""

import json
from itertools import count

import numpy as np
import pytest
from support.figures import captured

import iswarm_mj.search.compare as compare_module
from iswarm_mj.search import plot_comparison
from iswarm_mj.search.compare import Candidate, ComparisonPlan, gather
from iswarm_mj.search.comparison import Comparison, Outcome
from iswarm_mj.utils import intervals
from iswarm_mj.utils.errors import SimulationFault, UserError

ABOUT = {
    "version": "1",
    "engine": "planar",
    "settings": {"seed": 0, "n_robots": 5, "n_worlds": 8},
    "config": {"arena": {"size": 15}, "drive": {"error_step": 0.1}},
    "task": {"class": "Cleaning"},
    "genome": {"turn": 1},
}


@pytest.fixture(autouse=True)
def _few_resamples(monkeypatch):
    monkeypatch.setattr(intervals, "RESAMPLES", 499)


def outcome(name, finished_at, about=None, **columns):
    """Return worlds of a candidate that finished at these steps of 100.

    Args:
        name: name of the candidate.
        finished_at: step of finishing of each world, or None.
        about: settings in place of those of `ABOUT`, by group.
        **columns: values of further columns, a list each.
    """
    rows = []
    for world, step in enumerate(finished_at):
        row = {"seed": 0, "world": world, "n_robots": 5, "max_steps": 100, "goal": 3}
        row |= {"delivered": 3, "finished_at": step, "fault": None}
        rows.append(row | {column: values[world] for column, values in columns.items()})
    settings = {group: values for group, values in ABOUT.items()}
    for group, values in (about or {}).items():
        settings[group] = values
    return Outcome(name, rows, settings)


def compared(*outcomes, measure=None, statistic="mean"):
    return Comparison.of(outcomes, measure, statistic)


FIRST = outcome("first", [40, 50, 60, 70, 80, 90, 50, 60])
LATER = outcome("later", [42, 52, 63, 73, 84, None, 55, 65], {"genome": {"turn": 2}})


class TestPairs:
    def test_worlds_with_the_same_layouts_are_paired(self):
        """Only the strategy and the drive differ, which no layout reads."""
        drive = {"arena": {"size": 15}, "drive": {"error_step": 0.2}}
        second = outcome("second", [45] * 8, {"config": drive, "genome": {"turn": 2}})
        comparison = compared(FIRST, second)
        assert comparison.effects["second"]["finished_at"].is_paired
        assert comparison.to_json()["differ_in"] == {
            "second": ["config.drive.error_step", "strategy"]
        }

    @pytest.mark.parametrize(
        ("group", "values", "name"),
        [
            ("version", "2", "version"),
            ("settings", {"seed": 1, "n_robots": 5}, "seed"),
            ("settings", {"seed": 0, "n_robots": 6}, "n_robots"),
            ("config", {"arena": {"size": 16}, "drive": {"error_step": 0.1}}, "arena.size"),
            ("task", {"class": "Foraging"}, "task.class"),
        ],
    )
    def test_worlds_with_other_layouts_are_not(self, group, values, name):
        second = outcome("second", [45] * 8, {group: values})
        comparison = compared(FIRST, second)
        assert not comparison.effects["second"]["finished_at"].is_paired
        sentence = f"Their layouts depend on {name}, so that worlds are not paired."
        assert sentence in comparison.sentences()

    def test_a_finished_run_with_more_worlds_counts_with_the_common_ones(self):
        """The first world of seven and the eight others of the first candidate are the same."""
        second = outcome("second", [40, 50, 60, 70, 80, 90, 50])
        result = compared(FIRST, second).effects["second"]["finished_at"]
        assert (result.n_first, result.n_second) == (7, 7)
        assert result.difference == (0, 0, 0)


class TestGoals:
    """`outcome` has the goal 3."""

    def with_goal(self, goal, about):
        second = outcome("second", [45] * 8, about)
        return second._replace(rows=[{**row, "goal": goal} for row in second.rows])

    def test_another_goal_in_the_same_layouts_is_refused(self):
        second = self.with_goal(1, {"settings": {**ABOUT["settings"], "stop_at": 1}})
        with pytest.raises(UserError, match="first stops at the goal 3 and second at 1; give both"):
            compared(FIRST, second)

    def test_the_default_and_the_same_number_are_one_goal(self):
        second = self.with_goal(3, {"settings": {**ABOUT["settings"], "stop_at": 3}})
        sentences = compared(FIRST, second).sentences()
        assert "second and first have the same settings." in sentences

    def test_another_goal_in_other_layouts_is_named(self):
        config = {"arena": {"size": 15, "n_dust": 9}, "drive": {"error_step": 0.1}}
        settings = {**ABOUT["settings"], "stop_at": 9}
        second = self.with_goal(9, {"settings": settings, "config": config})
        names = compared(FIRST, second).differs_in("second")
        assert names == ["config.arena.n_dust", "settings.stop_at"]


class TestWorldsThatCountOtherwise:
    def test_unfinished_worlds_count_as_the_length_of_the_run(self):
        comparison = compared(FIRST, LATER)
        expected = np.mean([42, 52, 63, 73, 84, 100, 55, 65])
        assert comparison.effects["later"]["finished_at"].second == expected
        sentence = (
            "1 of 8 worlds of later did not finish; they count as 100 steps, the length of the run."
        )
        assert sentence in comparison.sentences()

    @pytest.mark.parametrize("failing", [None, "0.3:50"])
    def test_robots_that_fail_with_their_balls_explain_unfinished_worlds(self, failing):
        settings = {**ABOUT["settings"], "failing": failing}
        failed = outcome("failed", [42, None, 63, 73, 84, None, 55, 65], {"settings": settings})
        text = " ".join(compared(FIRST, failed).sentences())
        assert "2 of 8 worlds of failed did not finish" in text
        assert ("Robots that fail keep their balls: lower the goal by --stop-at" in text) == (
            failing is not None
        )

    def test_a_world_with_a_fault_and_its_pair_do_not_count(self):
        second = outcome("second", [1, 50, 60, 70, 80, 90, 50, 60])
        second.rows[0]["fault"] = "step 1: a robot left the arena"
        comparison = compared(FIRST, second)
        result = comparison.effects["second"]["finished_at"]
        assert result.n_first == result.n_second == 7
        assert result.difference == (0, 0, 0)
        assert "1 of 8 worlds of second had a fault, and do not count." in comparison.sentences()

    def test_values_of_the_sentence_are_those_of_the_pairs(self):
        """The first candidate's world of 20 steps is left out with its pair."""
        first = outcome("first", [20, 50, 60, 70, 80, 90, 50, 60])
        second = outcome("second", [1, 51, 61, 71, 81, 91, 51, 61])
        second.rows[0]["fault"] = "step 1: a robot left the arena"
        sentence = compared(first, second).sentences()[0]
        assert "66.7 against 65.7, difference 1 (1 to 1)" in sentence
        assert sentence.endswith("in 7 worlds with the same layouts.")

    def test_a_candidate_of_faults_ends_the_comparison(self):
        second = outcome("second", [10, 20])
        for row in second.rows:
            row["fault"] = "step 1: a robot left the arena"
        with pytest.raises(SimulationFault, match="2 of 2 worlds of second had a fault"):
            compared(FIRST, second)


class TestResult:
    def test_a_decided_result_states_direction_and_interval(self):
        sentence = compared(FIRST, LATER).sentences()[0]
        beginning = (
            "later has a higher mean finished_at than first: 66.8 against 62.5, difference 4.25 ("
        )
        assert sentence.startswith(beginning)
        assert sentence.endswith("in 8 worlds with the same layouts.")

    def test_an_undecided_result_states_what_is_possible(self):
        second = outcome("second", [60, 40, 70, 60, 90, 80, 40, 71])
        comparison = compared(FIRST, second, statistic="median")
        low, high = comparison.effects["second"]["finished_at"].difference[1:]
        sentence = comparison.sentences()[0]
        assert sentence.startswith(
            "It is not decided whether second or first has the higher median"
        )
        assert sentence.endswith(f"effects between {low:.3g} and {high:.3g} are possible.")

    def test_worlds_that_differ_do_not_count_as_the_same(self):
        """All resamples of these medians are 50."""
        first = outcome("first", [50] * 11 + [10], picked=[5] * 11 + [1])
        second = outcome("second", [50] * 12, picked=[5] * 12)
        comparison = compared(first, second, statistic="median")
        sentences = comparison.sentences()
        assert sentences[0].startswith(
            "second and first have the same median finished_at, though worlds differ: 50 against 50"
        )
        assert "measures taken one by one at 95 %: undecided: picked" in sentences[1]
        assert "picked" in "\n".join(comparison.table())

    def test_measures_that_differ_nowhere_are_left_out(self):
        picked = [3, 4, 5, 6, 7, 8, 9, 1]
        first = outcome("first", [9] * 8, picked=picked)
        second = outcome("second", [8] * 8, picked=[n + 1 for n in picked])
        table = "\n".join(compared(first, second).table())
        assert "picked" in table and "delivered" not in table

    def test_measures_that_not_all_have_are_named(self):
        """One is unknown in all worlds of the second, one is text there, one it does not have.

        What no world knows is not named.
        """
        first = outcome(
            "first", [9] * 8, carried=[1] * 8, note=[None] * 8, extra=[2] * 8, impact=[None] * 8
        )
        second = outcome(
            "second", [8] * 8, carried=[None] * 8, note=["late"] * 8, impact=[None] * 8
        )
        comparison = compared(first, second)
        assert {"carried", "note", "extra"}.isdisjoint(comparison.effects["second"])
        ending = "no other measure differs; not compared: carried, note, extra."
        assert comparison.sentences()[1].endswith(ending)

    def test_the_result_is_about_times_only_if_a_world_without_a_fault_finished(self):
        outcomes = [outcome(name, [5] + [None] * 8) for name in ("first", "second")]
        for each in outcomes:
            each.rows[0]["fault"] = "step 1: a robot left the arena"
        assert compared(*outcomes).measure == "delivered"

    def test_the_result_is_about_deliveries_if_no_world_finished(self):
        outcomes = [outcome(name, [None] * 8) for name in ("first", "second")]
        assert compared(*outcomes).measure == "delivered"
        assert compared(*outcomes, measure="finished_at").measure == "finished_at"
        with pytest.raises(UserError, match="one of delivered, finished_at"):
            compared(*outcomes, measure="share")

    def test_files_hold_worlds_effects_and_figure(self, tmp_path):
        third = outcome("third", [None, 10, 10, 20, 20, 10, 10, 20], carried=[None] * 8)
        comparison = compared(FIRST, LATER, third)
        comparison.write(tmp_path)
        names = {path.name for path in tmp_path.iterdir()}
        assert names == {
            "compare.csv",
            "compare.parquet",
            "compare.json",
            "compare.png",
            "compare.svg",
        }
        content = json.loads((tmp_path / "compare.json").read_text())
        assert [*content["effects"]] == ["later", "third"]
        assert content["unfinished"] == {"first": 0, "later": 1, "third": 1}
        assert content["effects"]["later"]["finished_at"]["difference"]["estimate"] == 4.25
        assert len((tmp_path / "compare.csv").read_text().splitlines()) == 1 + 3 * 8

    def test_the_figure_shows_all_worlds_and_pairs(self, monkeypatch, tmp_path):
        axes = captured(monkeypatch, plot_comparison)
        compared(FIRST, LATER).draw(tmp_path / "compare")
        left, right = axes["compare"]
        n_dots = {marker: 0 for marker in "o^"}
        for line in left.lines:
            if line.get_marker() in n_dots:
                n_dots[line.get_marker()] += len(line.get_xdata())
        assert n_dots == {"o": 15, "^": 1}
        pairs = [line for line in left.lines if len(line.get_xdata()) == 2]
        assert len(pairs) == 8
        assert right.get_ylabel() == "difference from first"

    def test_the_figure_shows_differences_filled_where_decided(self, monkeypatch, tmp_path):
        axes = captured(monkeypatch, plot_comparison)
        undecided = outcome("undecided", [60, 40, 70, 60, 90, 80, 40, 71])
        comparison = compared(FIRST, LATER, undecided)
        comparison.draw(tmp_path / "compare")
        bars = axes["compare"][1].containers
        for container, name in zip(bars, ("later", "undecided"), strict=True):
            middle, low, high = comparison.effects[name]["finished_at"].difference
            ((segment,),) = [ends.get_segments() for ends in container.lines[2]]
            assert container.lines[0].get_ydata().tolist() == [middle]
            assert segment[:, 1].tolist() == pytest.approx([low, high])
            is_filled = container.lines[0].get_markerfacecolor() != "white"
            assert is_filled == (name == "later")

    def test_the_caption_says_which_worlds_the_differences_are_of(self):
        """Worlds of another seed are not paired with those of the first candidate."""
        other = outcome("other", [45] * 8, {"settings": {"seed": 1, "n_robots": 5}})
        paired = plot_comparison._caption(compared(FIRST, LATER))
        assert "by bootstrap over pairs of worlds, others left out;" in paired
        unpaired = plot_comparison._caption(compared(FIRST, other))
        assert "by bootstrap over worlds;" in unpaired
        both = plot_comparison._caption(compared(FIRST, LATER, other))
        assert "by bootstrap over pairs of worlds or worlds;" in both


@pytest.fixture
def pretended(monkeypatch):
    """Let a run be its first world and number of worlds, and return a list of those made."""
    made = []

    def rows_of_run(run):
        name, first, n_worlds = run
        made.append(run)
        rng = np.random.default_rng([len(name), first])
        steps = rng.normal(300, 60, n_worlds).round()
        return [dict(row) for row in outcome(name, steps.tolist()).rows]

    monkeypatch.setattr(compare_module, "rows_of_run", rows_of_run)
    monkeypatch.setattr(compare_module, "about", lambda run: ABOUT)
    return made


def candidate(name):
    return Candidate(name, 100, lambda first, n: (name, first, n), identity=name)


def test_runs_of_other_lengths_are_refused_before_they_begin(pretended):
    with pytest.raises(UserError, match="a runs for 100 steps and bb for 200"):
        gather([candidate("a"), candidate("bb")._replace(steps=200)], ComparisonPlan())
    assert not pretended


def test_a_finished_run_of_one_world_is_refused_before_others_run(pretended):
    finished = Candidate("runs/a", 100, finished={"n_worlds": 1})
    with pytest.raises(UserError, match="the run in runs/a has 1 world; intervals need"):
        gather([candidate("a"), finished], ComparisonPlan())
    assert not pretended


class TestWorldsThatAreAdded:
    def test_worlds_are_added_until_the_interval_is_narrow_enough(self, pretended):
        """The half-width of n worlds is 2 sqrt(2) 60 / 300 / sqrt(n), 0.1 of 32 worlds."""
        plan = ComparisonPlan(worlds=8, precision=0.1)
        comparison = gather([candidate("a"), candidate("bb")], plan)
        n_worlds = len(comparison.outcomes[0].rows)
        assert 24 <= n_worlds <= 48
        assert comparison.half_width <= 0.1
        assert [row["world"] for row in comparison.outcomes[1].rows] == [*range(n_worlds)]
        batches = [(first, n) for name, first, n in pretended if name == "a"]
        assert batches == [(first, 8) for first in range(0, n_worlds, 8)]

    def test_there_is_a_maximum(self, pretended):
        plan = ComparisonPlan(worlds=4, precision=1e-6, max_worlds=14)
        comparison = gather([candidate("a"), candidate("bb")], plan)
        assert len(comparison.outcomes[0].rows) == 12
        share = 100 * comparison.half_width
        sentence = f"{share:.3g} % of a's mean, more than the precision of 0.0001 %"
        assert sentence in "\n".join(comparison.sentences())
        result = comparison.to_json()
        assert (result["precision"], result["half_width"]) == (1e-6, comparison.half_width)

    def test_the_first_worlds_are_no_more_than_the_maximum(self, pretended):
        plan = ComparisonPlan(precision=1e-6, max_worlds=20)
        comparison = gather([candidate("a"), candidate("bb")], plan)
        assert [len(each.rows) for each in comparison.outcomes] == [20, 20]

    def test_a_share_of_zero_adds_no_worlds(self, pretended, monkeypatch):
        monkeypatch.setattr(
            compare_module, "rows_of_run", lambda run: outcome("a", [0] * run[2]).rows
        )
        plan = ComparisonPlan(worlds=6, precision=0.1)
        comparison = gather([candidate("a"), candidate("bb")], plan)
        assert len(comparison.outcomes[0].rows) == 6
        assert "The precision is a share of a's mean, which is 0; no more worlds are added." in (
            comparison.sentences()
        )

    def test_finished_worlds_are_kept(self, pretended, tmp_path):
        plan = ComparisonPlan(worlds=4)
        first = gather([candidate("a"), candidate("bb")], plan, tmp_path)
        second = gather([candidate("a"), candidate("bb"), candidate("ccc")], plan, tmp_path)
        assert [name for name, *_ in pretended] == ["a", "bb", "ccc"]
        assert second.rows()[:8] == first.rows()
        gather([candidate("a"), candidate("bb")], plan, tmp_path, again=True)
        assert len(pretended) == 5


@pytest.mark.slow
def test_comparisons_of_equal_strategies_hold_no_difference(monkeypatch):
    """200 whole comparisons, each of 16 worlds of two equal strategies."""
    numbers = count()
    rng_of_call = lambda: np.random.default_rng(next(numbers))  # noqa: E731
    monkeypatch.setattr(compare_module, "about", lambda run: ABOUT)
    monkeypatch.setattr(
        compare_module,
        "rows_of_run",
        lambda run: [
            dict(row) for row in outcome("a", rng_of_call().poisson(30, 16).tolist()).rows
        ],
    )
    n_undecided = 0
    for _ in range(200):
        comparison = gather([candidate("a"), candidate("bb")], ComparisonPlan(worlds=16))
        n_undecided += not comparison.effects["bb"]["finished_at"].is_decided
    assert 0.93 <= n_undecided / 200 <= 0.97
