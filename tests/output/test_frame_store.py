"""Frames on disk become the file that all at once would have become."""

import io

import numpy as np
import pytest
from helpers_files import full_disk
from helpers_swarm_recording import joined, make_frames, make_scene

from iswarm_mj.output.frame_store import FrameStore
from iswarm_mj.utils.errors import UserError


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
    blocks = [made(n, n) for n in (1, 64, 64, 7)]
    found, wanted = io.BytesIO(), io.BytesIO()
    stored(tmp_path, blocks).write(found, {"about": np.bytes_(b"{}"), "size": np.arange(3.0)})
    together = {name: np.ascontiguousarray(values) for name, values in joined(blocks).arrays().items()}
    np.savez(wanted, **together, about=np.bytes_(b"{}"), size=np.arange(3.0))
    assert found.getvalue() == wanted.getvalue()


def test_a_full_disk_ends_with_a_sentence_and_keeps_what_was_there(tmp_path):
    store, block = stored(tmp_path, [made(64, 2)]), made(64, 3)
    with full_disk(3000), pytest.raises(UserError, match=r"cannot be written \(File too large\); make room"):
        store.append(block)
    for wanted in ([made(64, 2)], [made(64, 2), block]):
        found = io.BytesIO()
        store.write(found, {})
        found.seek(0)
        np.testing.assert_array_equal(np.load(found)["pose"], joined(wanted).pose)
        store.append(block)  # there is room again
