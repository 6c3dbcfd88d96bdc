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

STEPS, SCOUTS = 110, Genome(fraction_scouts=1.0)
"""Scouts lift no balls, so that a run of them takes all its steps."""


@pytest.mark.parametrize(("frames", "frames_of_bytes", "largest"), [(5, 99, 5), (99, 4, 4)])
def test_blocks_grow_with_the_run_up_to_some_frames_and_bytes(
    small, tmp_path, monkeypatch, frames, frames_of_bytes, largest
):
    run = run_of(small, SCOUTS, steps=STEPS)
    start = RecordedWorld.of_run(run, 0).frames([run.start])
    each = sum(array.nbytes for array in start.arrays().values())
    given_back = []
    limits = {
        "BLOCK_FRAMES": 2,
        "MAX_BLOCK_FRAMES": frames,
        "MAX_BLOCK_BYTES": frames_of_bytes * each,
        "LARGE_BLOCK_BYTES": 4 * each,
    }
    for name, value in limits.items():
        monkeypatch.setattr(recorder, name, value)
    monkeypatch.setattr(recorder, "give_back", lambda: given_back.append(1))
    run_swarm(run, tmp_path)
    chunks = RrdReader(tmp_path / "clean.rrd").stream().to_chunks()
    rows = [len(c.to_record_batch()) for c in chunks if c.entity_path == "/world/robots/body" and not c.is_static]
    assert sum(rows) == run.step + 1 == STEPS + 1 and max(rows) == largest and rows.count(2) >= 16
    assert len(given_back) == sum(n >= 4 for n in rows) > 0


def test_a_run_ends_while_the_disk_has_room_to_complete_its_files(small, tmp_path, monkeypatch):
    """With all that it took so far; the disk is large at first, and full after two blocks."""
    left = [10**9, 0]
    monkeypatch.setattr(shutil, "disk_usage", lambda path: SimpleNamespace(free=left.pop(0)))
    said = r"clean\.rrd cannot be written \(No space left on device\); make room"
    with pytest.raises(UserError, match=said):
        run_swarm(run_of(small, SCOUTS, steps=STEPS * BLOCK_FRAMES), tmp_path)
    content, steps = json.loads((tmp_path / "result.json").read_text()), load(tmp_path).arrays["step"]
    assert content["interrupted"] and content["steps"] == steps[-1] == 2 * BLOCK_FRAMES - 1
    assert read(tmp_path / "clean.rrd")["/world/robots/body"]["step"] == steps.tolist()
