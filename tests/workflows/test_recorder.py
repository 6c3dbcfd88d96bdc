"""Blocks in which frames of a run are written; memory is given back after large ones."""

import json
import shutil
from types import SimpleNamespace

import pytest
from rerun.chunk import RrdReader
from support.rrd import read
from support.runs import run_of

from iswarm_mj import load
from iswarm_mj.output.frames import BLOCK_FRAMES, RecordedWorld
from iswarm_mj.strategy.genome import Genome
from iswarm_mj.utils.errors import UserError
from iswarm_mj.workflows import recorder
from iswarm_mj.workflows.clean import run_swarm

STEPS = 110
SCOUTS = Genome(fraction_scouts=1.0)
"""Scouts pick up no balls, so that a run of them takes all its steps."""
LARGE_BLOCK = 4
"""Number of frames from which on a block counts as large here."""


@pytest.mark.parametrize(
    ("max_frames", "frames_that_fit", "longest"),
    [
        pytest.param(5, 99, 5, marks=pytest.mark.slow, id="frames"),
        pytest.param(99, 4, 4, id="bytes"),
    ],
)
def test_blocks_grow_with_the_run_up_to_a_limit(
    small, tmp_path, monkeypatch, max_frames, frames_that_fit, longest
):
    """Limits are a number of frames and a number of bytes."""
    run = run_of(small, SCOUTS, steps=STEPS)
    start = RecordedWorld.of_run(run, 0).frames([run.start])
    frame_bytes = sum(array.nbytes for array in start.arrays().values())
    calls = []
    monkeypatch.setattr(recorder, "BLOCK_FRAMES", 2)
    monkeypatch.setattr(recorder, "MAX_BLOCK_FRAMES", max_frames)
    monkeypatch.setattr(recorder, "MAX_BLOCK_BYTES", frames_that_fit * frame_bytes)
    monkeypatch.setattr(recorder, "LARGE_BLOCK_BYTES", LARGE_BLOCK * frame_bytes)
    monkeypatch.setattr(recorder, "give_back", lambda: calls.append(1))

    run_swarm(run, tmp_path)

    blocks = [
        len(chunk.to_record_batch())
        for chunk in RrdReader(tmp_path / "clean.rrd").stream().to_chunks()
        if chunk.entity_path == "/world/robots/body" and not chunk.is_static
    ]
    assert sum(blocks) == run.step + 1 == STEPS + 1
    assert max(blocks) == longest and blocks.count(2) >= 16
    assert len(calls) == sum(n_frames >= LARGE_BLOCK for n_frames in blocks) > 0


def test_a_run_ends_while_the_disk_has_space_to_complete_its_files(small, tmp_path, monkeypatch):
    """The disk is large at first, and full after two blocks, which are kept."""
    free = [10**9, 0]
    monkeypatch.setattr(shutil, "disk_usage", lambda path: SimpleNamespace(free=free.pop(0)))
    message = r"clean\.rrd cannot be written \(No space left on device\); make room"
    with pytest.raises(UserError, match=message):
        run_swarm(run_of(small, SCOUTS, steps=STEPS * BLOCK_FRAMES), tmp_path)

    content = json.loads((tmp_path / "result.json").read_text())
    steps = load(tmp_path).arrays["step"]
    assert content["interrupted"]
    assert content["steps"] == steps[-1] == 2 * BLOCK_FRAMES - 1
    assert read(tmp_path / "clean.rrd")["/world/robots/body"]["step"] == steps.tolist()
