"""Frames on disk become the file that all of them at once would have become."""

import io

import numpy as np
import pytest
from support.files import full_disk
from support.swarm_recording import joined, make_frames, make_scene

from iswarm_mj.output.trajectory import TRAJECTORY
from iswarm_mj.utils.errors import UserError
from iswarm_mj.workflows.recorder import FrameStore

SCENE = make_scene(3, 2)


def make_block(n_frames, seed):
    """Frames of any values, also with an array that is not in C order."""
    frames = make_frames(SCENE, n_frames, seed)
    values = np.random.default_rng(seed).normal(size=(n_frames, 3))
    frames.memory["turned"] = values.T.copy().T
    return frames


def store_of(directory, blocks):
    store = FrameStore(directory)
    for block in blocks:
        store.append(block)
    return store


def test_the_file_is_that_of_numpy(tmp_path):
    blocks = [make_block(n_frames, seed=n_frames) for n_frames in (1, 64, 64, 7)]
    store_of(tmp_path, blocks).write(SCENE, {})

    expected = io.BytesIO()
    arrays = joined(blocks).arrays()
    contiguous = {name: np.ascontiguousarray(values) for name, values in arrays.items()}
    np.savez(expected, **contiguous, **SCENE.arrays(), about=np.bytes_(b"{}"))
    assert (tmp_path / TRAJECTORY).read_bytes() == expected.getvalue()


def test_a_full_disk_ends_with_a_sentence_and_keeps_the_frames_before(tmp_path):
    first = make_block(64, seed=2)
    second = make_block(64, seed=3)
    store = store_of(tmp_path, [first])
    message = r"cannot be written \(File too large\); make room"
    with full_disk(3000), pytest.raises(UserError, match=message):
        store.append(second)
    assert_written(store, tmp_path, [first])

    store.append(second)  # there is space again
    assert_written(store, tmp_path, [first, second])


def assert_written(store, directory, blocks):
    """Check that a trajectory of a store has the poses of these blocks."""
    store.write(SCENE, {})
    with np.load(directory / TRAJECTORY) as file:
        np.testing.assert_array_equal(file["pose"], joined(blocks).pose)
