"""Experiments: which runs they are made of, what they find in made-up rows, and what a directory keeps."""

import hashlib
import json
import re
from dataclasses import replace

import numpy as np
import pytest

from iswarm_mj.config import READINGS, SwarmConfig
from iswarm_mj.experiments.analysis import paper
from iswarm_mj.experiments.analysis.findings import FAILS, HOLDS, NOT_RUN, TOO_FEW, UNDECIDED, number, verdict_of
from iswarm_mj.experiments.analysis.measures import TIME, quartiles, values
from iswarm_mj.experiments.analysis.statistics import compare
from iswarm_mj.experiments.runner import resumable
from iswarm_mj.experiments.runner.checkpoint import Journal
from iswarm_mj.experiments.runner.experiment import Entry, Plan, row_of, run_experiment, run_seed
from iswarm_mj.experiments.runner.jobs import Outcome, run_job
from iswarm_mj.experiments.runner.pool import Execution
from iswarm_mj.experiments.studies import density, hop_count, robustness, sensitivity, swarm_types
from iswarm_mj.experiments.studies.registry import EXPERIMENTS, experiment, listing
from iswarm_mj.simulation.metrics import Measures, fitness
from iswarm_mj.strategy.genome import PRESETS
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.lock import locked
from iswarm_mj.utils.serialization import to_dict
from iswarm_mj.utils.tables import read_table

PLAN = Plan()


def rows_of(entries, outcome):
    """Rows with outcomes by a function of the entry."""
    return [row_of(entry, outcome(entry)) for entry in entries]


def done(job, time, delivered=66, collisions=280, carriage=50.0):
    """Outcome of a run that reached its goal after `time` steps, or did not, where it is None."""
    return Outcome(delivered, delivered, collisions, carriage, time, time or job.steps, 0.0)


def type_rows(one, two):
    """Rows of the paper's types that finish about these steps, with a standard deviation of 30."""
    rng, rows = np.random.default_rng(0), []
    for entry in swarm_types.entries(PLAN):
        if entry.labels["type"] in paper.PAPER_FITNESS:
            k, second = entry.labels["repeat"], entry.labels["type"] == "type2"
            time = round((two if second else one) + rng.normal(0, 30))
            points = 2880 + 10 * (800 - time) - 5
            outcome = done(entry.job, time, 72)._replace(fitness=float(points))
            gathers = (0.5 if second else 0.3) + 0.001 * k if k < 6 else None
            rows.append({**row_of(entry, outcome), "aggregation": gathers})
    return rows


class TestPlans:
    def test_hop_counts_are_those_of_the_paper(self):
        """12 and 12 runs of 280 robots until 66 balls or 1200 steps; nothing else differs."""
        entries = hop_count.entries(PLAN)
        jobs = [entry.job for entry in entries]
        assert [job.genome.use_hop_count for job in jobs] == [True] * 12 + [False] * 12
        assert {replace(job.genome, use_hop_count=True) for job in jobs} == {PRESETS["type1"]}
        assert {(job.n_robots, job.steps, job.stop_at) for job in jobs} == {(280, 1200, 66)}

    def test_densities_are_those_of_the_paper(self):
        entries = density.entries(PLAN)
        found = {entry.labels["density"]: entry.job.n_robots for entry in entries}
        assert min(found) == 0.05 and max(found) == 0.4 and len(entries) == 12 * len(found)
        assert found[0.05] == 119 and found[0.4] == 950
        assert {(entry.job.steps, entry.job.stop_at) for entry in entries} == {(1200, 66)}

    def test_sensitivity_varies_one_value_at_a_time(self):
        """Each job's configuration differs from the default in the value that its label names, and nowhere else."""
        usual = SwarmConfig()
        for entry in sensitivity.entries(PLAN):
            differing = [
                (f"{part}.{name}", str(value))
                for part, mine in vars(entry.job.config).items()
                for name, value in vars(mine).items()
                if value != getattr(getattr(usual, part), name)
            ]
            choice, value = entry.labels["choice"], entry.labels["value"]
            assert differing == ([] if choice == "default" else [(choice, value)])

    @pytest.mark.parametrize("quick, n_runs", [(False, 10), (True, 3)])
    def test_sensitivity_varies_the_update_order(self, quick, n_runs):
        entries = sensitivity.entries(replace(PLAN, quick=quick))
        in_turn = [e for e in entries if e.job.config.strategy.update_order == "sequential"]
        later = [e for e in entries if e.labels["group"] == "readings"]
        assert in_turn + later == entries[-n_runs - len(later) :]  # so that the seeds of the others are what they were
        assert {e.labels["group"] for e in in_turn} == {"update order"} and len(later) == (n_runs if quick else 11 * 10)

    @pytest.mark.parametrize(("reading", "other"), [("paper", "all"), ("initial", "front")])
    def test_sensitivity_leaves_out_what_is_the_default(self, reading, other):
        entries = sensitivity.entries(Plan(READINGS[reading]))
        sides = {e.labels["value"] for e in entries if e.labels["choice"] == "strategy.avoidance_sides"}
        assert sides == {other}

    def test_dead_robots_are_there_and_absent_ones_are_not(self):
        entries = robustness.entries(PLAN)
        half = {e.labels["kind"]: e.job for e in entries if e.labels["fraction"] == 0.5}
        assert (half["dead"].n_robots, half["dead"].failed_fraction) == (280, 0.5)
        assert (half["absent"].n_robots, half["absent"].failed_fraction) == (140, 0.0)
        assert {e.labels["fraction"] for e in entries if e.labels["kind"] == "dead"} == {0, 0.1, 0.2, 0.3, 0.4, 0.5}

    def test_types_have_the_densities_of_table_2(self):
        found = {e.labels["type"]: (e.job.n_robots, e.job.steps, e.job.stop_at) for e in swarm_types.entries(PLAN)}
        assert found["type1"] == (280, 800, None) and found["type2"] == (314, 800, None)

    @pytest.mark.parametrize("name", EXPERIMENTS)
    def test_no_two_runs_are_the_same(self, name):
        """Another seed, another experiment's seed: other runs; the quick version is smaller."""
        one, other = (EXPERIMENTS[name].entries(replace(PLAN, seed=seed)) for seed in (0, 1))
        seeds = [entry.job.seed for entry in [*one, *other]]
        assert len(set(seeds)) == len(seeds)
        quick = EXPERIMENTS[name].entries(replace(PLAN, quick=True))
        assert sum(e.job.steps * e.job.n_robots for e in quick) < 0.3 * sum(e.job.steps * e.job.n_robots for e in one)

    def test_seeds_stay(self):
        assert run_seed(0, 1, 2) == run_seed(0, 1, 2) != run_seed(0, 2, 1)
        assert 0 <= run_seed(7, 0) < 2**32 - 1

    def test_an_unknown_name_lists_the_others(self):
        with pytest.raises(
            UserError,
            match=rf"'hops'; there are hop-count, density, .*{list(EXPERIMENTS)[-1]}: ",
        ):
            experiment("hops")
        assert [line.split()[0] for line in listing().splitlines()] == list(EXPERIMENTS)


class TestFindings:
    @pytest.mark.parametrize("name", EXPERIMENTS)
    def test_without_rows_nothing_was_run(self, name):
        found = EXPERIMENTS[name].findings([])
        assert found and {finding.verdict for finding in found} == {NOT_RUN}

    def test_hop_counts_that_help(self):
        def outcome(entry):
            job, k = entry.job, entry.labels["repeat"]
            if job.genome.use_hop_count:
                return done(job, 150 + k, 66, 3000 + k, 60.0 + k)
            return done(job, None, 20 + k, 9000 + k, 300.0 + k)

        rows = rows_of(hop_count.entries(PLAN), outcome)
        found = hop_count.findings(rows)
        assert [finding.verdict for finding in found] == [HOLDS] * 4
        assert "12 of 12 runs reached 66 balls with, 0 of 12 without" in found[0].ours
        assert found[0].ours.startswith("median 156 (third quartile 158) steps with, 1200 (third quartile 1200) steps")
        assert "U = 0," in found[0].statistics and "U = 144," in found[1].statistics

    def test_hop_counts_that_hinder_or_do_nothing(self):
        """Statements turned round do not hold; equal samples leave open what scatters, and refute what does not."""
        entries = hop_count.entries(PLAN)
        worse = rows_of(entries, lambda e: done(e.job, 400 if e.job.genome.use_hop_count else 150 + e.labels["repeat"]))
        assert hop_count.findings(worse)[0].verdict == FAILS
        same = rows_of(entries, lambda e: done(e.job, 150 + e.labels["repeat"]))
        assert [finding.verdict for finding in hop_count.findings(same)] == [UNDECIDED, FAILS, FAILS, FAILS]

    @pytest.mark.parametrize("name", EXPERIMENTS)
    def test_the_runs_of_a_quick_version_are_too_few(self, name):
        """Nothing is judged, however clear the runs are."""
        rows = rows_of(
            EXPERIMENTS[name].entries(replace(PLAN, quick=True)), lambda e: done(e.job, 100 + e.labels["repeat"])
        )
        rows = [row | {"aggregation": 0.3, "overlap": 0.05, "ms_per_step": 2.0} for row in rows]
        found = EXPERIMENTS[name].findings(rows)
        verdicts = {finding.verdict for finding in found}
        assert verdicts <= {TOO_FEW, NOT_RUN, ""} and (TOO_FEW in verdicts or name == "infer")  # which judges nothing

    @pytest.mark.parametrize(
        "best, sparse, verdicts",
        [
            (0.15, None, [HOLDS, HOLDS, HOLDS, HOLDS, HOLDS, HOLDS, FAILS]),
            (0.2, 900, [FAILS, FAILS, FAILS, UNDECIDED, HOLDS, FAILS, FAILS]),
            (0.4, None, [FAILS, FAILS, FAILS, FAILS, HOLDS, HOLDS, FAILS]),
        ],
    )
    def test_densities(self, best, sparse, verdicts):
        """All measures are lowest at one density; 0.05 finishes late or not at all, all others do."""

        def outcome(entry):
            d, k = entry.labels["density"], entry.labels["repeat"]
            far = 1 + abs(d - best)
            time = sparse if d == 0.05 else round(150 * far) + k
            return done(entry.job, time, 66 if time else 40, round(280 * far * entry.job.n_robots), 60 * far)

        found = density.findings(rows_of(density.entries(PLAN), outcome))
        assert [finding.verdict for finding in found] == verdicts
        assert found[0].ours.startswith(f"lowest median at {best:g}; 0.05: ")
        assert f"the lowest median is at {best:g} in 100 % of 9999 bootstrap" in found[0].statistics

    def test_densities_that_are_alike_are_open(self):
        """The times of all scatter alike, so that any may be lowest; half of the runs of 0.05 finish."""

        def outcome(entry):
            d, k = entry.labels["density"], entry.labels["repeat"]
            time = None if d == 0.05 and k % 2 else 150 + (k * round(1000 * d) // 50 * 7) % 30
            return done(entry.job, time, 66 if time else 40)

        found = density.findings(rows_of(density.entries(PLAN), outcome))
        assert (found[0].verdict, found[3].verdict, found[5].verdict) == (UNDECIDED,) * 3

    def test_a_choice_that_slows_the_swarm_down(self):
        """Wrong bits triple the time; a wall range stops all but two runs."""

        def outcome(entry):
            choice, k = entry.labels["choice"], entry.labels["repeat"]
            if entry.labels["choice"] == "optics.wall_range" and k > 1:
                return done(entry.job, None, 10)
            return done(entry.job, (450 if choice == "optics.independent_bit_errors" else 150) + k)

        rows = rows_of(sensitivity.entries(PLAN), outcome)
        reaches, grips, changes = sensitivity.findings(rows)
        assert reaches.verdict == UNDECIDED and "wall_range = 0.75: 2/10 runs" in reaches.ours
        assert grips.verdict == HOLDS and grips.ours == "4 of 4 choices"
        assert "independent_bit_errors = True: +300 (+298 to +302" in changes.ours
        assert "dust_range" not in changes.ours
        found = {change.effect.label: change for change in sensitivity.changes(rows)}
        same, slow = found["random_turn = 90.0"], found["independent_bit_errors = True"]
        assert same.effect.value.estimate == 0 and same.p == same.adjusted == 1.0
        assert (
            slow.adjusted == pytest.approx(min(1, len(found) * slow.p))
            and f"by Holm {number(slow.adjusted, 2)})" in changes.ours
        )

    def test_a_choice_with_which_no_run_gets_there(self):
        """At 50 % of humidity, by arithmetic; elsewhere the statement on the choices themselves fails."""

        def rows(name):
            def outcome(entry):
                fails = (entry.labels["choice"], entry.labels["value"]) == name
                return done(entry.job, None if fails else 150 + entry.labels["repeat"], 10 if fails else 66)

            return rows_of(sensitivity.entries(PLAN), outcome)

        humid, blind = rows(("gripper.relative_humidity", "50.0")), rows(("optics.line_of_sight", "False"))
        assert [f.verdict for f in sensitivity.findings(humid)] == [HOLDS, FAILS, ""]
        assert [f.verdict for f in sensitivity.findings(blind)] == [FAILS, HOLDS, ""]

    def test_robustness(self):
        def outcome(entry):
            share, k = entry.labels["fraction"], entry.labels["repeat"]
            slow = 2 if entry.labels["kind"] == "dead" else 1
            return done(entry.job, None if share == 0.5 and slow == 2 else round(150 * (1 + slow * share)) + k)

        rows = rows_of(robustness.entries(PLAN), outcome)
        robust, cost = robustness.findings(rows)
        assert robust.verdict == FAILS and "50 %: 0 of 12 runs, median 1200 steps" in robust.ours
        assert cost.ours.startswith("10 %: 15 steps (") and "50 %: 970 steps (" in cost.ours and cost.verdict == HOLDS
        assert cost.statistics.count("(") == 5 and "adjusted by Holm for 5 shares, n = 12 + 12 each" in cost.statistics

    def test_bodies_that_cost_nothing(self):
        rows = rows_of(robustness.entries(PLAN), lambda e: done(e.job, 150 + 7 * e.labels["repeat"] % 12))
        assert [finding.verdict for finding in robustness.findings(rows)] == [HOLDS, UNDECIDED]

    def test_types_that_are_the_papers(self):
        """Times about 310 and 311 steps and the fitness that follows from them; aggregation is compared."""
        clean, times, alike, fitness, gather = swarm_types.findings(type_rows(310, 311))[:5]
        assert [f.verdict for f in (clean, times, alike, fitness, gather)] == [HOLDS] * 5
        assert clean.ours == "96 of 96 runs of type1, 96 of 96 runs of type2"
        assert times.ours.startswith("type1: median 313 steps (95 % interval 304 to 321), +1 %; type2: ")
        assert "within ±31.2 steps, 10 % of the medians" in alike.statistics

    @pytest.mark.parametrize(
        "one, two, repeats, verdicts",
        [
            (310, 380, 96, [FAILS, FAILS, FAILS]),  # 22 % later; 7075 points, 9 % off
            (200, 201, 96, [FAILS, HOLDS, FAILS]),
            (310, 345, 8, [UNDECIDED, UNDECIDED, UNDECIDED]),
            (310, 345, 4, [TOO_FEW, TOO_FEW, TOO_FEW]),
        ],
    )
    def test_types_that_are_not(self, one, two, repeats, verdicts):
        """By intervals: what differs is told from what is only uncertain, and nothing follows from a few runs."""
        rows = [row for row in type_rows(one, two) if row["repeat"] < repeats]
        assert [f.verdict for f in swarm_types.findings(rows)[1:4]] == verdicts

    @pytest.mark.parametrize("points, collisions, n_robots, step", [(7771, 180, 280, 310), (7766, 80, 314, 311)])
    def test_the_papers_times_follow_from_its_fitness(self, points, collisions, n_robots, step):
        """The formula of section 4.6 gives the paper's points with so many collisions a robot, and not a step later."""
        made = Measures(72, 72, collisions * n_robots, None, step)
        assert paper.latest_finish(points) == step
        assert fitness(made, n_robots, 72, 800) == pytest.approx(points)
        assert fitness(made._replace(collisions=0, finished_at=step + 1), n_robots, 72, 800) < points

    def test_another_preset_is_held_against_both_types(self):
        rows = [
            {
                **e.labels,
                "aggregation": None,
                "goal": 72,
                "max_steps": 800,
                "finished_at": 400,
                "fitness": 100 * (e.labels["type"] == "evolved") + e.labels["repeat"],
            }
            for e in swarm_types.entries(PLAN)
        ]
        better = swarm_types.findings(rows)[5:]
        assert [(f.claim, f.verdict) for f in better] == [
            ("The preset evolved is fitter than type1", HOLDS),
            ("The preset evolved is fitter than type2", HOLDS),
        ]

    def test_aggregation_by_hand(self):
        """Of the empty workers two of three are near a dust area in the first step, none in the second."""
        rd = 2e-3 * np.sqrt(2)
        far = [0.0, 20 * rd, 0.0]
        near, edge = [16 * rd, 0.0, 0.0], [(16 - 3 - 3.4) * rd, 0.0, 0.0]
        frames = {
            "pose": np.array([[near, edge, far, near, near], [far] * 5, [near] * 5]),
            "is_loaded": np.array([[False, False, False, True, False]] * 3),
            "scene_is_scout": np.array([False, False, False, False, True]),
            "scene_dust_areas": np.array([[13.0, -3, 19, 3], [-19, -3, -13, 3]]) * rd,
            "ball_position": np.zeros((3, 4, 3)),
            "delivered": np.array([0, 1, 2]),
        }
        assert swarm_types.aggregation(frames) == pytest.approx((2 / 3 + 0) / 2)

    def test_a_verdict_needs_a_direction_and_an_interval(self):
        low, high = np.arange(12.0), np.arange(12.0) + 20
        assert verdict_of(compare(high, low), is_larger=True) == HOLDS
        assert verdict_of(compare(high, low), is_larger=False) == FAILS
        assert verdict_of(compare(low, low + 1), is_larger=False) == UNDECIDED
        assert verdict_of(compare(high[:4], low[:4]), is_larger=True) == TOO_FEW

    @pytest.mark.parametrize(
        "value, text",
        [
            (0.0, "0"),
            (-0.0, "0"),
            (1234.5, "1234"),
            (0.0123, "0.0123"),
            (2e-7, "2.00e-07"),
            (12.0, "12"),
            (159.4, "159"),
            (1.2e7, "1.20e+07"),
            (float("nan"), "undefined"),
        ],
    )
    def test_numbers_are_readable(self, value, text):
        assert number(value) == text

    def test_what_has_no_value_is_left_out(self):
        rows = [{"finished_at": None, "max_steps": 9}, {"finished_at": 4, "max_steps": 9}]
        assert values(rows, TIME).tolist() == [9, 4] and quartiles(np.array([])) == "no value"


class TestDirectory:
    @pytest.fixture
    def counted(self, monkeypatch):
        """Jobs that are really done, by a stand-in that takes no time."""
        seen = []

        def run_jobs(jobs, execution):
            for index, job in enumerate(jobs):
                seen.append(job)
                yield index, done(job, 100 + job.seed % 50 + (0 if job.genome.use_hop_count else 300))

        monkeypatch.setattr(resumable, "run_jobs", run_jobs)
        return seen

    def test_table_findings_and_figures(self, counted, tmp_path, capsys):
        plan = replace(PLAN, quick=True, seed=3)
        run_experiment(EXPERIMENTS["hop-count"], plan, tmp_path)
        rows, settings = read_table(tmp_path / "hop_count.parquet")
        assert [row["seed"] for row in rows] == [entry.job.seed for entry in hop_count.entries(plan)]
        assert rows[0]["collisions_per_robot"] == 1.0 and rows[0]["goal"] == 66 and rows[0]["max_steps"] == 300
        assert settings["seed"] == 3 and settings["quick"] is True and settings["genome"]["p_vector_forget"] == 0.29
        assert settings["config"]["optics"]["led_beam_aperture"] == 60.0 and settings["version"]
        found = read_table(tmp_path / "findings.parquet")[0]
        assert len(found) == 4 and found[0]["verdict"] == TOO_FEW and found[0]["kind"] == "predicted"
        assert (tmp_path / "hop_count.png").stat().st_size > 10_000
        assert "</svg>" in (tmp_path / "hop_count.svg").read_text()
        assert "too few runs to judge" in capsys.readouterr().out

    def test_finished_runs_are_not_done_again(self, counted, tmp_path):
        plan = replace(PLAN, quick=True)
        run_experiment(EXPERIMENTS["density"], plan, tmp_path)
        table = (tmp_path / "density.parquet").read_bytes()
        assert len(counted) == 8
        run_experiment(EXPERIMENTS["density"], plan, tmp_path)
        assert len(counted) == 8 and (tmp_path / "density.parquet").read_bytes() == table
        run_experiment(EXPERIMENTS["density"], replace(plan, seed=1), tmp_path)
        assert len(counted) == 16
        run_experiment(EXPERIMENTS["density"], plan, tmp_path, Execution("mjx"))
        assert len(counted) == 24
        run_experiment(EXPERIMENTS["density"], plan, tmp_path, again=True)
        assert len(counted) == 32

    def test_runs_of_another_implementation_are_others(self, counted, tmp_path, monkeypatch):
        plan = replace(PLAN, quick=True)
        for impl, n_runs in (("jax", 8), ("warp", 16), ("jax", 16), ("warp", 16)):
            monkeypatch.setattr("iswarm_mj.experiments.runner.batches.implementation", lambda impl=impl: impl)
            run_experiment(EXPERIMENTS["density"], plan, tmp_path, Execution("mjx"))
            assert len(counted) == n_runs and read_table(tmp_path / "density.parquet")[1]["impl"] == impl

    def test_runs_of_earlier_programs_are_found(self, counted, tmp_path):
        """A journal written before readings, message time and engines were added, with outcomes no run has."""
        plan = Plan(READINGS["initial"], quick=True)
        entries = hop_count.entries(plan)
        with Journal(tmp_path / "runs.jsonl", {"kind": "runs of experiments"}) as journal:
            for place, entry in enumerate(entries):
                job = json.dumps(["mujoco", to_dict(entry.job)], sort_keys=True)
                assert not re.search(
                    "update_order|baud_rate|slots|avoidance_sides|priority_repulsion|odometry|engine", job
                )
                digest = hashlib.sha256(job.encode()).hexdigest()
                journal.add((int(digest[:13], 16),), done(entry.job, 1000 + place))
        run_experiment(EXPERIMENTS["hop-count"], plan, tmp_path)
        rows, _ = read_table(tmp_path / "hop_count.parquet")
        assert counted == [] and [row["finished_at"] for row in rows] == [1000 + k for k in range(len(entries))]

    def test_a_running_experiment_keeps_its_runs(self, counted, tmp_path):
        """Another one that is to discard them is refused before it does."""
        (tmp_path / "runs.jsonl").write_text("of the running one")
        with locked(tmp_path), pytest.raises(UserError, match="is in use by another process"):
            run_experiment(EXPERIMENTS["hop-count"], Plan(quick=True), tmp_path, again=True)
        assert (tmp_path / "runs.jsonl").read_text() == "of the running one" and counted == []

    def test_an_interruption_keeps_what_is_finished(self, counted, tmp_path, monkeypatch):
        working = resumable.run_jobs

        def broken(jobs, *rest):
            for k, item in enumerate(working(jobs, *rest)):
                if k == 3:
                    raise KeyboardInterrupt
                yield item

        monkeypatch.setattr(resumable, "run_jobs", broken)
        plan = replace(PLAN, quick=True)
        with pytest.raises(KeyboardInterrupt):
            run_experiment(EXPERIMENTS["hop-count"], plan, tmp_path)
        monkeypatch.setattr(resumable, "run_jobs", working)
        before = len(counted)
        run_experiment(EXPERIMENTS["hop-count"], plan, tmp_path)
        assert len(counted) - before == 3

    def test_runs_of_another_version_are_refused(self, counted, tmp_path, monkeypatch):
        plan = replace(PLAN, quick=True)
        run_experiment(EXPERIMENTS["hop-count"], plan, tmp_path)
        monkeypatch.setattr("iswarm_mj.experiments.runner.checkpoint.versions", lambda: {"iswarm_mj": "0.0.1"})
        with pytest.raises(UserError, match=r"different versions .*choose another `out`"):
            run_experiment(EXPERIMENTS["hop-count"], plan, tmp_path)

    def test_real_runs_of_a_small_arena(self, small, tmp_path):
        """The table tells what the runs themselves give, and all of it follows from it."""
        plan = Plan(config=small, quick=True)
        entries = hop_count.entries(plan)
        short = [Entry(e.labels, replace(e.job, steps=30)) for e in entries[::3]]
        made = replace(EXPERIMENTS["hop-count"], entries=lambda _: short)
        run_experiment(made, plan, tmp_path, Execution(workers=1))
        rows, settings = read_table(tmp_path / "hop_count.parquet")
        outcome = run_job(short[0].job)
        assert {name: rows[0][name] for name in outcome._asdict()} == outcome._asdict()
        assert settings["config"]["arena"]["size"] == 15
        assert rows[0]["goal"] == 22 and rows[0]["n_robots"] == short[0].job.n_robots == round(0.118 * 216)
        lines = (tmp_path / "runs.jsonl").read_text().splitlines()
        assert json.loads(lines[0].partition(" ")[2])["settings"] == {"kind": "runs of experiments"}
        assert len(lines) == 1 + len(short)
