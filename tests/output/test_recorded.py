"""Directories of runs that something else wrote, or damaged: one sentence each, at once."""

import json
import os

import numpy as np
import pytest
from helpers_recorded import arrays, write_run

from iswarm_mj.config import SwarmConfig
from iswarm_mj.output.stage import recorded
from iswarm_mj.output.trajectory import RESULT, TRAJECTORY
from iswarm_mj.utils.errors import UserError

SAID = r"/(result\.json|trajectory\.npz)\b[^\n]*; give the --out of a run of `iswarm clean`, or [^\n]*\.$"
UNKNOWN = r"/(result\.json|trajectory\.npz) has settings that [^\n]*; read it with the one that wrote it\.$"


def test_what_is_read(tmp_path):
    run = recorded(write_run(tmp_path))
    assert run.config == SwarmConfig()
    for name, values in arrays().items():
        np.testing.assert_array_equal(run.arrays[name], values)


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
        {"scene_memory_sizes": np.full(99, 2**31 - 1)},
    ],
)
def test_arrays_that_make_no_run(tmp_path, changed):
    with pytest.raises(UserError, match=SAID):
        recorded(write_run(tmp_path, **changed))


def test_truncated_anywhere(tmp_path):
    data = (write_run(tmp_path) / TRAJECTORY).read_bytes()
    for length in range(0, len(data), 97):
        (tmp_path / TRAJECTORY).write_bytes(data[:length])
        with pytest.raises(UserError, match=SAID):
            recorded(tmp_path)


def test_flipped_bits_are_found_or_harmless(tmp_path):
    """Most stand in numbers, whose checksum then differs; names and dates in the archive are not protected."""
    data = (write_run(tmp_path) / TRAJECTORY).read_bytes()
    rng = np.random.default_rng(0)
    n_refused = 0
    for place, bit in zip(rng.integers(len(data), size=300), rng.integers(8, size=300), strict=True):
        changed = bytearray(data)
        changed[place] ^= 1 << bit
        (tmp_path / TRAJECTORY).write_bytes(changed)
        try:
            found = recorded(tmp_path).arrays
        except UserError as error:
            n_refused += 1
            assert "\n" not in str(error)
        else:
            for name, values in arrays().items():
                np.testing.assert_array_equal(found[name], values)
    assert n_refused > 150


@pytest.mark.parametrize(
    ("interrupted", "recording", "said"),
    [
        (
            True,
            "clean.rrd",
            r"unfinished or was killed: wait .* `iswarm clean --config .*/result.json`\. .*/clean",
        ),
        (
            True,
            "run.rrd",
            r"was killed: wait for its end, or repeat it by `iswarm run --config .*/result.json`\. .*/run",
        ),
        (False, "clean.rrd", r"although its run has ended; put it back, or repeat it by `iswarm clean --config"),
        (False, None, r"since no world was recorded; run it without --no-record\.$"),
    ],
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


@pytest.mark.parametrize("name", [RESULT, TRAJECTORY])
class TestWhatIsNoFile:
    def replace(self, out, name):
        (write_run(out) / name).unlink()
        return out / name

    def refused(self, out):
        with pytest.raises(UserError, match=f"{SAID}|{UNKNOWN}"):
            recorded(out)

    def test_a_pipe_is_not_waited_for(self, tmp_path, name):
        os.mkfifo(self.replace(tmp_path, name))
        self.refused(tmp_path)

    def test_a_file_without_end_is_not_read(self, tmp_path, name):
        self.replace(tmp_path, name).symlink_to("/dev/zero")
        self.refused(tmp_path)

    def test_a_link_to_itself_and_to_nothing(self, tmp_path, name):
        path = self.replace(tmp_path, name)
        path.symlink_to(path)
        self.refused(tmp_path)
        path.unlink()
        path.symlink_to(tmp_path / "nothing")
        self.refused(tmp_path)

    def test_a_huge_file_is_not_read(self, tmp_path, name):
        with self.replace(tmp_path, name).open("wb") as file:
            file.truncate(2**40)
        self.refused(tmp_path)

    @pytest.mark.parametrize(
        "text", ["", "[]", "null", '{"config": 1}', '{"config": {"arena": {"size": -1}}}', "[" * 9999]
    )
    def test_something_else(self, tmp_path, name, text):
        self.replace(tmp_path, name).write_text(text)
        self.refused(tmp_path)
