"""The command `iswarm tip`: what it prints and writes, and how it goes with other commands."""

import io
import json
import math
from contextlib import redirect_stdout
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
import trimesh
from support.cli import code_of, refused, result

from iswarm_mj.commands.main import parse
from iswarm_mj.gripper.tips.search import Limits
from iswarm_mj.gripper.tips.shapes import read_profile
from iswarm_mj.workflows.tip import design_tip, result_of, summary
from iswarm_mj.workflows.tip_settings import TipSettings

ONE_BALL = ["--radius=20e-6", "--out=out"]


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


class Designed(NamedTuple):
    """What a command printed, and its directory."""

    printed: str
    out: Path


@pytest.fixture(scope="module")
def rounded(tmp_path_factory):
    """Return the design of a rounded tip."""
    out = tmp_path_factory.mktemp("rounded")
    output = io.StringIO()
    with redirect_stdout(output):
        assert code_of("tip", "--tip-curvature=30e-6", "--radius=20e-6", f"--out={out}") == 0
    return Designed(output.getvalue(), out)


def test_a_rounded_tip_lowers_the_higher_voltage(rounded):
    printed = rounded.printed
    assert "rounded, radius 13 um, height 2.96 um, bulging at the axis with 30 um" in printed
    assert "grasp 32.6 V, release 32.5 V (flat tip 25.0 and 41.9 V)" in printed

    content = result(rounded.out)
    (row,) = content["rows"]
    assert row["grasp_voltage"] == pytest.approx(32.6, abs=0.1)
    assert row["adhesion_radius"] == pytest.approx(12e-6, rel=0.02)
    assert content["highest_voltage"] == max(row["grasp_voltage"], row["release_voltage"])
    assert [each["gap"] for each in content["tolerances"] if not each["misplacement"]] == (
        pytest.approx([3e-6, 4e-6, 5e-6, 6e-6, 7e-6, 8e-6])
    )


@pytest.mark.slow
def test_the_solid_is_closed_and_the_points_are_read_again(here):
    assert code_of("tip", "--shape=cone", "--half-angle=70", *ONE_BALL) == 0
    solid = trimesh.load(here / "out/tip.stl")
    assert solid.is_watertight
    assert solid.extents[0] == pytest.approx(26, rel=1e-3)
    points = read_profile(here / "out/profile.csv")
    assert points.radius == pytest.approx(13e-6, rel=1e-6)
    assert (here / "out/tip.png").stat().st_size > 10_000

    first = result("out")["rows"][0]
    assert code_of("tip", "--profile=out/profile.csv", "--radius=20e-6", "--out=again") == 0
    again = result("again")["rows"][0]
    for column in ("grasp_voltage", "release_voltage"):
        assert again[column] == pytest.approx(first[column], rel=0.02)


def test_inspect_repeats_the_summary(rounded, capfd):
    assert code_of("inspect", str(rounded.out)) == 0
    printed = capfd.readouterr().out
    assert "grasp 32.6 V, release 32.5 V" in printed
    assert f"iswarm tip --config {rounded.out}/result.json repeats it" in printed
    assert f"iswarm tip --profile {rounded.out}/profile.csv" in printed


def test_it_takes_the_table_of_the_bench_in_fit_toml(here):
    (here / "fit.toml").write_text("[grasp]\nelectrical_gap = 3e-7\n[gripper]\ntool_error = 1e-6\n")
    assert parse(["tip", "--config=fit.toml", *ONE_BALL]).electrical_gap == 3e-7


@pytest.mark.slow
def test_it_warns_of_one_work_beyond_the_fit(here, capfd):
    assert code_of("tip", "--work-tool-object=2e-3", *ONE_BALL) == 0
    printed = capfd.readouterr().out
    assert "beyond the fit, so that voltages are predictions: work_tool_object 0.002" in printed


@pytest.mark.slow
def test_it_takes_a_file_for_the_bench_and_results_of_its_own(here, capfd):
    (here / "fit.toml").write_text(
        "work_tool_object = 2e-3\nwork_object_substrate = 12e-3\nrepeats = 3\n[protocol]\npress = 2e-8\n"
    )
    assert code_of("tip", "--config=fit.toml", "--tip-curvature=40e-6", *ONE_BALL) == 0
    first = result("out")
    assert first["tip"]["work_tool_object"] == 2e-3
    printed = capfd.readouterr().out
    assert "own values  in place of those fitted to the paper: work_tool_object 0.002" in printed
    assert "beyond the fit" not in printed
    assert code_of("tip", "--config=out/result.json", "--out=again") == 0
    assert result("again")["rows"] == first["rows"]


def test_a_file_with_an_unknown_key_is_refused(here, capfd):
    (here / "fit.toml").write_text("work_tool = 2e-3\n")
    assert "does not know" in refused(capfd, here, "tip", "--config=fit.toml")


def test_adhesion_reaches_as_far_as_the_electrical_gap_unless_it_is_given():
    ball = {"radius": 20e-6, "humidity": 10.0}
    assert TipSettings(electrical_gap=0.3e-6).conditions(**ball).reach == 0.3e-6
    assert TipSettings(electrical_gap=0.3e-6, reach=20e-9).conditions(**ball).reach == 20e-9
    assert TipSettings().conditions(**ball).reach == 0.2e-6


def test_humidities_and_gaps_make_rows(here):
    settings = TipSettings(radius=("15e-6", "20e-6"), rh=(10.0, 40.0), gap=(3e-6, 5e-6))
    rows = design_tip(settings).rows
    assert len(rows) == 8
    assert not list(here.iterdir())
    by_place = {(row.radius, row.gap, row.relative_humidity): row for row in rows}
    dry = by_place[20e-6, 5e-6, 10.0]
    humid = by_place[20e-6, 5e-6, 40.0]
    factor = 1 + 30 / 70
    assert humid.tool_adhesion == pytest.approx(dry.tool_adhesion * factor)
    assert by_place[20e-6, 3e-6, 10.0].release_voltage < dry.release_voltage


@pytest.mark.slow
def test_a_search_writes_its_history_and_repeats(here):
    search = ["--optimise", "--generations=2", "--population=4", "--workers=1", *ONE_BALL]
    assert code_of("tip", *search, "--limits.radius=20e-6") == 0
    content = result("out")
    assert content["tip"]["optimise"] is True
    assert len(content["history"]) == 2
    assert content["profile"]["radius"] <= 20e-6 * (1 + 1e-6)
    curvature = np.abs(content["profile"]["arcs"]["curvature"])
    assert curvature.max() <= 1 / 2e-6 * (1 + 1e-9)

    assert code_of("tip", "--config=out/result.json", "--workers=1", "--out=again") == 0
    assert json.dumps(result("again")["rows"]) == json.dumps(content["rows"])


def test_a_search_that_finds_no_profile_within_the_height_warns():
    limits = Limits(height=0.5e-6)
    settings = TipSettings(
        radius=("20e-6",), optimise=True, limits=limits, generations=1, population=4, workers=1
    )
    warnings = [text for name, text in summary(settings, design_tip(settings)) if name == "warning"]
    assert "no profile within the height of 0.5 um" in warnings[0]


def test_a_release_that_no_voltage_makes_is_null_in_json():
    settings = TipSettings(radius=("20e-6",))
    design = design_tip(settings)
    endless = design.rows[0]._replace(release_voltage=math.inf, release_field=math.inf)
    content = result_of(settings, design._replace(rows=[endless]), seconds=1.0)
    read = json.loads(json.dumps(content, allow_nan=False))
    assert read["rows"][0]["release_voltage"] is None
    assert read["rows"][0]["grasp_voltage"] == endless.grasp_voltage
    assert read["highest_voltage"] is None


@pytest.mark.slow
def test_the_bench_takes_the_works_of_a_tip(here):
    assert code_of("tip", "--work-tool-object=2e-3", *ONE_BALL) == 0
    assert (
        code_of("grasp", "--config=out/result.json", "--repeats=1", "--record", "--out=trials") == 0
    )
    assert result("trials")["grasp"]["work_tool_object"] == 2e-3
