"""Which results a report takes, and which choices it names."""

import shlex
from dataclasses import asdict, replace

import pytest
import tyro
from helpers_findings import search_rows, settings_of
from helpers_hop_count import write_hop_count

from iswarm_mj.commands.evolve import Evolve
from iswarm_mj.commands.main import main
from iswarm_mj.config import ArenaConfig, OpticsConfig, SwarmConfig
from iswarm_mj.experiments.report import assumptions
from iswarm_mj.experiments.report.results import collect, files_in
from iswarm_mj.experiments.runner.evolution import Operators
from iswarm_mj.experiments.runner.experiment import Plan
from iswarm_mj.experiments.runner.pool import Execution
from iswarm_mj.experiments.runner.search import Search
from iswarm_mj.experiments.runner.search import settings_of as settings_of_search
from iswarm_mj.strategy.genome import PRESETS
from iswarm_mj.utils.tables import read_table, write_table


class TestChoices:
    def test_they_are_what_the_configuration_says_without_the_paper(self):
        found = {choice.name: choice for choice in assumptions.assumed()}
        assert found["strategy.dust-range"].value == "0.75" and "senses a ball" in found["strategy.dust-range"].meaning
        assert "optics.led-beam-aperture" not in found and "gripper.work-tool-object" not in found
        assert found["strategy.update-order"].value == "synchronous"
        assert all(choice.meaning for choice in found.values()) and len(found) > 15

    def test_each_value_is_the_papers_or_calibrated_or_on_the_list(self):
        """The numbers of Table 1 and section 3.2; words without a number, as on the dump, give no value."""
        every = {setting.name: setting for setting in assumptions.settings()}
        assert {f"{part}.{name}".replace("_", "-") for part, own in asdict(SwarmConfig()).items() for name in own} == {
            *every
        }
        papers = {
            "arena.size": "49.0",
            "arena.n-dust": "72",
            "arena.ball-radius-min": "1.5e-05",
            "arena.ball-radius-max": "2.5e-05",
            "drive.step-length": "0.5",
            "optics.communication-radius": "3.5",
            "optics.led-beam-aperture": "60.0",
            "optics.error-distance-measure": "0.1",
            "optics.error-in-communication": "0.1",
            "optics.p-communication-break": "0.1",
            "gripper.relative-humidity": "10.0",
            "gripper.release-gap": "5e-06",
        }
        assert {name: every[name].value for name in assumptions.GIVEN} == papers
        assert all(place in every[name].meaning for name, place in assumptions.GIVEN.items())
        calibrated = {name for name in every if name.startswith(("gripper.work-", "gripper.spread-"))}
        assert {choice.name for choice in assumptions.assumed()} == {*every} - {*papers} - calibrated
        assert calibrated == {name for name, setting in every.items() if "calibrated" in setting.meaning}
        fitted = {setting.value for setting in assumptions.fitted()}
        assert len(calibrated) == 4 and {every[name].value for name in calibrated} <= fitted

    @pytest.mark.parametrize(
        "name",
        [
            "arena.dump-size",
            "strategy.avoidance-course",
            "optics.baud-rate",
            "optics.slots",
            "optics.photodiodes-while-emitting",
        ],
    )
    def test_the_papers_words_do_not_make_a_value_the_papers(self, name):
        (found,) = (choice for choice in assumptions.assumed() if choice.name == name)
        assert "section" in found.meaning.lower()

    def test_what_was_fitted(self):
        assert {c.name for c in assumptions.fitted()} >= {"WORK_TOOL_OBJECT", "WORK_OBJECT_SUBSTRATE", "CONTACT_GAP"}
        assert assumptions.fitting().startswith("The default constants are a calibration, not measurements.")
        assert len(assumptions.operators()) >= 5 and all("\n" not in item for item in assumptions.operators())


class TestResults:
    def test_full_tables_come_before_quick_ones(self, results):
        found = collect([results])
        assert found.used["hop-count"].path == results / "full/hop_count.parquet"
        assert found.left_out == [results / "quick/hop_count.parquet"]
        assert list(found.used) == ["grasp", "evolve-paper", "hop-count"]

    def test_a_larger_quick_table_does_not_come_first(self, tmp_path):
        write_hop_count(tmp_path / "a", Plan())
        full = collect([tmp_path]).used["hop-count"]
        (tmp_path / "b").mkdir()
        write_table(tmp_path / "b/hop_count.parquet", [*full.rows, *full.rows], {**full.settings, "quick": True})
        found = collect([tmp_path])
        assert found.used["hop-count"].path == full.path
        assert found.left_out == [tmp_path / "b/hop_count.parquet"]

    def test_links_out_of_the_directory_are_not_followed(self, results, tmp_path):
        inside = tmp_path / "inside"
        (inside / "types").mkdir(parents=True)
        write_table(inside / "types" / "evolution.parquet", search_rows(), settings_of())
        (inside / "same.parquet").symlink_to(inside / "types" / "evolution.parquet")
        for name in ("evolution.parquet", "type1.png"):
            (inside / name).symlink_to(results / "evolve" / "evolution.parquet")
        found = collect([inside])
        assert [result.path for result in found.used.values()] == [inside / "types" / "evolution.parquet"]
        assert found.left_out == [] and list(files_in(inside, "*.png")) == []

    @pytest.mark.parametrize("rows", [[{"a": 1}], [{"seed": None, "finished_at": "x"}], None])
    def test_odd_tables_are_left_out_and_named(self, tmp_path, rows):
        names = "hop_count.parquet", "evolution.parquet", "trials.parquet"
        settings = {"experiment": "hop-count", "method": "paper", "quick": False}
        for name in names:
            if rows is None:
                (tmp_path / name).write_bytes(b"PAR1 and no more")
            else:
                write_table(tmp_path / name, rows, settings)
        found = collect([tmp_path])
        assert found.used == {} and sorted(path.name for path in found.unusable) == sorted(names)

    def test_commands_make_them_again(self, results):
        found = collect([results])
        assert found.used["hop-count"].command == (
            "iswarm experiment hop-count --genome type1 --seed 0 --optics.wall-range 2.0 --out DIR"
        )
        assert found.used["evolve-paper"].command.startswith(
            "iswarm evolve --method paper --generations 120 --population 10 "
        )
        assert found.used["grasp"].command.startswith(
            "iswarm grasp --radius 1.5e-05 2.5e-05 --rh 10 30 --repeats 5 --seed 4 "
        )
        assert " --quick" in collect([results / "quick"]).used["hop-count"].command

    def test_operators_and_another_setting_are_told(self, tmp_path):
        """The command brings back the settings; a comment says what is not the paper's."""
        search = Search(
            SwarmConfig(arena=ArenaConfig(n_dust=24), optics=OpticsConfig(line_of_sight=False)),
            Operators(elite=3, relative_span=True),
            steps=200,
        )
        write_table(tmp_path / "evolution.parquet", search_rows(1), asdict(search))
        told, _, comment = collect([tmp_path]).used["evolve-paper"].command.partition("  # ")
        assert comment == "not the paper's setting: arena.n-dust 24, 200 steps"
        given = tyro.cli(Evolve, args=told.split()[2:])
        assert (given.operators, given.arena, given.optics, given.steps) == (
            search.operators,
            search.config.arena,
            search.config.optics,
            200,
        )

    def test_replicates_and_the_engine_come_back(self, tmp_path):
        search = Search(replicates=4, operators=Operators(boolean_mutation="redraw"))
        settings = settings_of_search(search, Execution("planar", refinement=1))
        write_table(tmp_path / "evolution.parquet", search_rows(1), settings)
        given = tyro.cli(Evolve, args=collect([tmp_path]).used["evolve-paper"].command.split()[2:])
        assert (given.replicates, given.operators, given.execution) == (
            4,
            search.operators,
            Execution("planar", refinement=1),
        )

    def test_an_experiment_in_another_arena_is_told(self, tmp_path):
        write_hop_count(tmp_path / "a", Plan(config=SwarmConfig(arena=ArenaConfig(n_dust=24))))
        assert (
            collect([tmp_path])
            .used["hop-count"]
            .command.endswith(" --arena.n-dust 24 --out DIR  # not the paper's setting: arena.n-dust 24")
        )

    @pytest.mark.parametrize("seed", ["0; reboot", 1.5, True, None, [1]])
    def test_a_seed_that_is_no_whole_number_makes_a_table_unusable(self, tmp_path, seed):
        write_hop_count(tmp_path / "a", Plan())
        rows, settings = read_table(tmp_path / "a/hop_count.parquet")
        write_table(tmp_path / "a/hop_count.parquet", rows, settings | {"seed": seed})
        found = collect([tmp_path])
        assert found.used == {} and found.unusable == [tmp_path / "a/hop_count.parquet"]

    def test_words_of_a_command_are_quoted(self, tmp_path):
        """Whatever a table says of its engine is one word of the shell."""
        write_hop_count(tmp_path / "a", Plan())
        rows, settings = read_table(tmp_path / "a/hop_count.parquet")
        write_table(tmp_path / "a/hop_count.parquet", rows, settings | {"engine": "x; echo $HOME"})
        words = shlex.split(collect([tmp_path]).used["hop-count"].command)
        assert words[words.index("--engine") + 1] == "x; echo $HOME"

    @pytest.mark.parametrize(
        "name, column",
        [("evolution.parquet", "fitness"), ("hop_count.parquet", "max_steps"), ("trials.parquet", "limit_voltage")],
    )
    def test_a_table_with_an_empty_column_is_named_in_a_sentence(self, results, tmp_path, capsys, name, column):
        (table,) = (result for result in collect([results]).used.values() if result.path.name == name)
        rows = [{**row, column: None} for row in table.rows]
        write_table(tmp_path / name, rows, table.settings)
        main(["report", "--results", str(tmp_path), "--out", str(tmp_path / "r.html")])
        assert f"left out, since it is damaged or holds something else: {tmp_path / name}" in capsys.readouterr().out
        main(["inspect", str(tmp_path)])
        told = capsys.readouterr().out
        assert name == "trials.parquet" or f"{name} is damaged, or holds something else" in told

    def test_a_genome_that_is_no_preset_is_told(self, tmp_path):
        write_hop_count(tmp_path / "a", Plan(genome=replace(PRESETS["type1"], fraction_scouts=0.5)))
        assert "--genome GENOME.json" in collect([tmp_path]).used["hop-count"].command

    def test_a_directory_that_is_not_there(self, capsys):
        with pytest.raises(SystemExit) as stop:
            main(["report", "--results", "nowhere"])
        assert stop.value.code == 2 and "--results must be an existing directory" in capsys.readouterr().err
