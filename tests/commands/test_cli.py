"""`iswarm clean`, and what the command line refuses."""

import importlib.util
import json
import re
from dataclasses import asdict

import numpy as np
import pytest
from helpers_cli import ARENA_FLAGS, CONFIG_FLOATS, GENOME_FLOATS, SMALL, code_of, refused, result
from helpers_small import FLAGS

from iswarm_mj import __version__ as version
from iswarm_mj.commands.main import main
from iswarm_mj.strategy.genome import PRESETS, Genome


class TestClean:
    def test_writes_results_and_prints_a_summary(self, small, capfd):
        assert code_of("clean", *SMALL, "--steps", 30, "--seed", 3) == 0
        out, _ = capfd.readouterr()
        content = result()
        assert content["config"] == json.loads(json.dumps(asdict(small)))
        assert (content["seed"], content["n_robots"], content["steps"], content["stop_at"]) == (3, 30, 30, 24)
        assert content["genome"] == asdict(PRESETS["type1"]) and content["engine"] == "mujoco"
        for line in (
            "robots  30 in 1 world(s), seed 3",
            f"delivered  {content['delivered']} of 24 balls; picked up {content['picked']}",
            f"collisions  {content['collisions']}",
            f"fitness  {content['fitness']:.1f}",
        ):
            assert line in out
        with np.load("runs/clean/trajectory.npz") as file:
            assert file["delivered"][-1] == content["delivered"] and len(file["step"]) == 31

    def test_no_record(self, here):
        assert code_of("clean", *SMALL, "--steps", 3, "--no-record", "--out", "some/where") == 0
        assert [p.name for p in (here / "some" / "where").iterdir()] == ["result.json"]

    def test_results_before_the_first_delivery(self, capfd):
        assert code_of("clean", *SMALL, "--steps", 1, "--no-record") == 0
        assert "finished at  step - (goal 24; ran 1 steps)" in capfd.readouterr().out
        assert result()["mean_carriage_steps"] is None and result()["finished_at"] is None

    def test_stop_at(self):
        assert code_of("clean", *SMALL, "--no-record", "--stop-at", 2, "--seed", 1) == 0
        content = result()
        assert 2 <= content["delivered"] < 24 and content["steps"] == content["finished_at"] < 800

    def test_worlds(self, capfd):
        assert code_of("clean", *SMALL, "--no-record", "--worlds", 3, "--steps", 5) == 0
        assert len(result()["collisions"]) == 3
        assert "30 in 3 world(s)" in capfd.readouterr().out

    def test_a_genome_file_and_single_parameters(self, here):
        (here / "mine.json").write_text('{"p_vector_forget": 0.5, "fraction_scouts": 0.2}')
        parameters = ["--genome=mine.json", "--fraction-scouts=0.4", "--use-hop-count=False"]
        assert code_of("clean", *SMALL, *parameters, "--steps=2", "--no-record") == 0
        expected = asdict(Genome(p_vector_forget=0.5, fraction_scouts=0.4, use_hop_count=False))
        assert result()["genome"] == expected

    def test_the_genome_tells_the_density(self):
        for flags, n_robots in (([], 25), (["--genome", "type2"], 29), (["--density", "0.05"], 11)):
            assert number_of_robots(*ARENA_FLAGS, *flags) == n_robots


def number_of_robots(*flags):
    """Number of robots that a run would have, without the run."""
    seen = []

    def clean(run, settings, *_):
        seen.append(settings.n_robots)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("iswarm_mj.workflows.clean.clean", clean)
        assert code_of("clean", *flags) == 0
    return seen[0]


class TestRefusals:
    @pytest.mark.parametrize(
        "flags, message",
        [
            (
                "--robots 217",
                r"--robots must be between 1 and 216 .*217\); use fewer robots or a larger --arena\.size",
            ),
            ("--density 0", r"--density must be above 0 and at most 1 \(got 0\.0\)$"),
            ("--density nan", r"--density must be .*\(got nan\)"),
            ("--density 0.1 --robots 10", r"--robots and --density exclude each other"),
            ("--steps -1", r"--steps must be a whole number between 1 and 1000000 \(got -1\)"),
            ("--seed -1", r"--seed must be .*\(got -1\)"),
            ("--stop-at 100", r"--stop-at must be between 1 and the number of balls, 24.*\(got 100\)"),
            ("--genome type3", r"--genome must be a preset \(type1, type2, evolved\) .*got 'type3'"),
            ("--genome nowhere.json", r"there is no file nowhere\.json"),
            ("--genome .", r"--genome must be a preset .*got '\.'"),
            ("--p-vector-forget 1.5", r"--p-vector-forget must be .*\(got 1\.5\)"),
        ],
    )
    def test_values_out_of_range(self, capfd, here, flags, message):
        base = ARENA_FLAGS if "--robots" in flags or "--density" in flags else SMALL
        assert re.search(message, refused(capfd, here, "clean", *base, *flags.split()))

    @pytest.mark.parametrize(
        ("impl", "engine", "says"),
        [
            ("warp", "mujoco", "left out with --engine mujoco"),
            ("jax", "planar", "numba or warp with --engine planar"),
            ("numba", "mjx", "jax or warp with --engine mjx"),
        ],
    )
    def test_implementations_of_other_engines(self, capfd, here, impl, engine, says):
        error = refused(capfd, here, "bench", *FLAGS, "--engine", engine, "--impl", impl)
        assert error == f"iswarm: --impl must be {says} (got '{impl}')\n"

    @pytest.mark.parametrize("engine", ["planar", "mjx"])
    def test_warp_that_is_not_installed(self, capfd, here, monkeypatch, engine):
        found = importlib.util.find_spec
        monkeypatch.setattr(importlib.util, "find_spec", lambda name, *a: None if name == "warp" else found(name, *a))
        error = refused(capfd, here, "clean", *FLAGS, "--robots=30", "--engine", engine, "--impl", "warp")
        assert error == "iswarm: --impl warp needs the package warp-lang; run pip install 'iswarm-mj[warp]'.\n"

    def test_physics_steps_that_are_too_long(self, capfd, here):
        error = refused(capfd, here, "clean", *SMALL, "--drive.step-length", "1")
        assert re.match(
            r"iswarm: --drive.walk-substeps must be at least 12 with --drive.step-length 1, so .*\(got 6\)", error
        )

    @pytest.mark.parametrize("value", ["nan", "inf", "-inf"])
    def test_every_float_must_be_finite(self, capfd, here, value):
        assert len(CONFIG_FLOATS) > 30 and len(GENOME_FLOATS) == 8
        for name in CONFIG_FLOATS + GENOME_FLOATS:
            flag = "--" + name.replace("_", "-")
            error = refused(capfd, here, "clean", f"{flag}={value}")
            assert f"(got {value})" in error and name.split(".")[-1].replace("_", "-") in error.replace("_", "-")

    @pytest.mark.parametrize(
        "text, message",
        [
            ('{"p_vector_forget": ', "no JSON"),
            ("[]", "holds a list"),
            ('{"fraction_scouts": 0.1, "fraction_scouts": 0.2}', "fraction_scouts occurs twice"),
            ('{"wings": 2}', "names 'wings'; allowed names are density_of_robots, "),
            ('{"fraction_scouts": 2}', "fraction_scouts must be between 0 and 1 (got 2)"),
            ('{"fraction_scouts": NaN}', "fraction_scouts must be between 0 and 1 (got nan)"),
        ],
    )
    def test_broken_genome_files(self, capfd, here, text, message):
        (here / "mine.json").write_text(text)
        error = refused(capfd, here, "clean", *SMALL, "--genome", "mine.json")
        assert message in error and "mine.json" in error

    def test_a_directory_that_cannot_be(self, capfd, here):
        (here / "file").write_text("mine")
        for out in ("file", "file/below", "file/far/below"):
            error = refused(capfd, here, "clean", *SMALL, "--steps", 2, "--out", out)
            assert f"--out must be a writable directory (got {out}); choose another (" in error
        assert (here / "file").read_text() == "mine"


def test_a_number_is_no_file_of_a_robot(capfd, here):
    assert "perhaps you meant --robots 5" in refused(capfd, here, "clean", "--robot", "5")


def test_version(capfd):
    assert code_of("--version") == 0
    assert capfd.readouterr() == (f"iswarm {version}\n", "")


def test_pictures_and_videos_say_where_they_are(monkeypatch, capfd):
    monkeypatch.setattr("iswarm_mj.output.render.render", lambda _, step, *__: 3 if step is None else step)
    monkeypatch.setattr("iswarm_mj.output.video.write_video", lambda *_: None)
    main(["picture", "runs/x", "--step", "7", "--camera", "oblique", "--out", "a.png"])
    main(["picture", "runs/x", "--out", "a.png"])
    main(["video", "runs/x", "--out", "a.mp4"])
    pictures = "step 7 of runs/x, oblique: a.png\nstep 3 of runs/x, above: a.png\n"
    assert capfd.readouterr().out == f"{pictures}video of runs/x: a.mp4\n"
