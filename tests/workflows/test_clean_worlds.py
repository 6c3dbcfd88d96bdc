"""Folders of the recorded worlds of a cleaning run."""

import numpy as np
from helpers_runs import run_of

from iswarm_mj.workflows.clean import clean


def test_each_recorded_world_has_its_own_folder(small, tmp_path):
    run = run_of(small, n_worlds=3, steps=4, record_worlds=(2, 0))
    content = clean(run, tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "clean.rrd",
        "result.json",
        "trajectory.npz",
        "world-0",
    ]
    for place, world in ((tmp_path, 2), (tmp_path / "world-0", 0)):
        with np.load(place / "trajectory.npz") as file:
            np.testing.assert_allclose(file["pose"][0, :, :2], 1e-3 * run.starts[world].poses[:, :2], rtol=1e-6)
            assert file["collisions"][-1] == content["collisions"][world]
    for name in ("delivered", "picked", "collisions", "mean_carriage_steps", "finished_at", "fitness"):
        assert len(content[name]) == content["n_worlds"] == 3
