"""`iswarm clean`, and what the command line refuses."""

import importlib.util
import json
import re
from dataclasses import asdict

import numpy as np
import pytest
from helpers_cli import ARENA_FLAGS, SMALL, code_of, refused, result
from helpers_small import FLAGS

from iswarm_mj import __version__ as version
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

    def test_stop_at(self):
        assert code_of("clean", *SMALL, "--no-record", "--stop-at", 2, "--seed", 1) == 0
        content = result()
        assert 2 <= content["delivered"] < 24 and content["steps"] == content["finished_at"] < 800

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

    def clean(run, *_):
        seen.append(run.settings.n_robots)

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
            ("--density 0.1 --robots 10", r"--robots and --density exclude each other"),
            ("--stop-at 100", r"--stop-at must be between 1 and the number of balls, 24.*\(got 100\)"),
            ("--genome type3", r"--genome must be a preset \(type1, type2, evolved\) .*got 'type3'"),
        ],
    )
    def test_values_out_of_range(self, capfd, here, flags, message):
        base = ARENA_FLAGS if "--robots" in flags or "--density" in flags else SMALL
        assert re.search(message, refused(capfd, here, "clean", *base, *flags.split()))

    def test_an_implementation_of_another_engine(self, capfd):
        assert code_of("bench", *FLAGS, "--engine", "planar", "--impl", "jax") == 2
        assert "'jax' for argument '--impl'" in capfd.readouterr().err

    def test_warp_that_is_not_installed(self, capfd, here, monkeypatch):
        found = importlib.util.find_spec
        monkeypatch.setattr(importlib.util, "find_spec", lambda name, *a: None if name == "warp" else found(name, *a))
        error = refused(capfd, here, "clean", *FLAGS, "--robots=30", "--engine", "planar", "--impl", "warp")
        assert error == "iswarm: --impl warp needs the package warp-lang; run pip install 'iswarm-mj[warp]'.\n"

    def test_a_directory_that_cannot_be(self, capfd, here):
        (here / "file").write_text("mine")
        for out in ("file", "file/far/below"):
            error = refused(capfd, here, "clean", *SMALL, "--steps", 2, "--out", out)
            assert f"--out must be a writable directory (got {out}); choose another (" in error
        assert (here / "file").read_text() == "mine"


@pytest.mark.parametrize(
    "arguments",
    [["replay", "--title", "a\udcff"], ["sweep", "clean", "--over", "seed=1,2", "--out", "a\udcff"], ["\udc80"]],
)
def test_arguments_that_are_no_text(capfd, here, arguments):
    assert "must be text in UTF-8 (got" in refused(capfd, here, *arguments)


@pytest.mark.parametrize("name", ["x" * 5000, "\x1b[31m" * 900])
def test_messages_are_short_and_end_with_the_remedy(capfd, here, name):
    error = refused(capfd, here, "clean", "--config", name)
    assert len(error) < 2000 and error.endswith("or a result.json.\n") and "\x1b" not in error


def test_a_number_is_no_file_of_a_robot(capfd, here):
    assert "perhaps you meant --robots 5" in refused(capfd, here, "clean", "--robot", "5")


def test_version(capfd):
    assert code_of("--version") == 0
    assert capfd.readouterr() == (f"iswarm {version}\n", "")
