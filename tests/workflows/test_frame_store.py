"""Frames on disk become the file that all at once would have become."""

import io

import numpy as np
import pytest
from support.files import full_disk
from support.swarm_recording import joined, make_frames, make_scene

from iswarm_mj.output.trajectory import TRAJECTORY
from iswarm_mj.utils.errors import UserError
from iswarm_mj.workflows.recorder import FrameStore


def made(n_frames, seed):
    """Frames of any values, also with an array that is not in C's order."""
    frames = make_frames(make_scene(3, 2), n_frames, seed)
    frames.memory["turned"] = np.random.default_rng(seed).normal(size=(n_frames, 3)).T.copy().T
    return frames


def stored(tmp_path, blocks):
    store = FrameStore(tmp_path)
    for block in blocks:
        store.append(block)
    return store


def test_the_file_is_that_of_numpy(tmp_path):
    blocks, wanted = [made(n, n) for n in (1, 64, 64, 7)], io.BytesIO()
    stored(tmp_path, blocks).write(make_scene(3, 2), {})
    together = {name: np.ascontiguousarray(values) for name, values in joined(blocks).arrays().items()}
    np.savez(wanted, **together, **make_scene(3, 2).arrays(), about=np.bytes_(b"{}"))
    assert (tmp_path / TRAJECTORY).read_bytes() == wanted.getvalue()


def test_a_full_disk_ends_with_a_sentence_and_keeps_what_was_there(tmp_path):
    store, block = stored(tmp_path, [made(64, 2)]), made(64, 3)
    with full_disk(3000), pytest.raises(UserError, match=r"cannot be written \(File too large\); make room"):
        store.append(block)
    for wanted in ([made(64, 2)], [made(64, 2), block]):
        store.write(make_scene(3, 2), {})
        np.testing.assert_array_equal(np.load(tmp_path / TRAJECTORY)["pose"], joined(wanted).pose)
        store.append(block)  # there is room again
