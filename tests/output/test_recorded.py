"""Directories of runs that something else wrote, or damaged: one sentence each, at once."""

import json

import numpy as np
import pytest
from helpers_recorded import write_run

from iswarm_mj.output.stage import recorded
from iswarm_mj.output.trajectory import RESULT, TRAJECTORY
from iswarm_mj.utils.errors import UserError

SAID = r"/(result\.json|trajectory\.npz)\b[^\n]*; give the --out of a run of `iswarm clean`, or [^\n]*\.$"


def test_an_interrupted_run_is_shown_and_named(tmp_path, capsys):
    write_run(tmp_path)
    content = json.loads((tmp_path / RESULT).read_text())
    (tmp_path / RESULT).write_text(json.dumps(content | {"interrupted": True}))
    assert len(recorded(tmp_path).arrays["step"]) == 3
    assert "was interrupted after step 2" in capsys.readouterr().err


@pytest.mark.parametrize(
    "changed",
    [
        {"step": np.zeros(0, np.int32)},
        {"step": np.array([0, 2, 4])},
        {"pose": np.full((3, 4, 3), np.nan)},
        {"ball_position": np.full((3, 2, 3), np.inf)},
        {"pose": np.zeros((3, 5, 3))},
        {"pose": np.float64(3)},
        {"is_loaded": np.zeros((3, 4), "U3")},
        {"delivered": np.array([{}, {}, {}], object)},
        {"scene_ball_radius": np.zeros((2, 2))},
        {"scene_ball_radius": np.array([2e-5, 0.0])},
        {"scene_memory_names": np.array(["link_valid", "about"])},
    ],
)
def test_arrays_that_make_no_run(tmp_path, changed):
    with pytest.raises(UserError, match=SAID):
        recorded(write_run(tmp_path, **changed))


@pytest.mark.parametrize(
    ("interrupted", "recording", "said"),
    [(True, "run.rrd", r"was killed: .*`iswarm run --config"), (False, None, r"since no world was recorded")],
)
def test_a_run_without_a_trajectory(tmp_path, interrupted, recording, said):
    """Of one that was killed there are its announcement and the recording until then."""
    (write_run(tmp_path) / TRAJECTORY).unlink()
    content = json.loads((tmp_path / RESULT).read_text())
    (tmp_path / RESULT).write_text(json.dumps(content | {"interrupted": interrupted}))
    if recording is not None:
        (tmp_path / recording).touch()
    with pytest.raises(UserError, match=rf"holds no trajectory\.npz, .*{said}"):
        recorded(tmp_path)
