"""A recording for which there is no room is refused with the cause, which Rerun itself only logs before it waits."""

import resource

import numpy as np
import pytest
import rerun as rr
import rerun.blueprint as rrb

from iswarm_mj.output.rerun_format import RrdFile
from iswarm_mj.utils.errors import UserError


def test_a_limit_of_files_is_named(tmp_path):
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, limits[1]))
    try:
        file = RrdFile("test", tmp_path / "clean.rrd", rrb.Blueprint())
        file.stream.log("points", rr.Points3D(np.random.default_rng(0).random((20_000, 3))))
        with pytest.raises(UserError, match="File too large"):
            file.flush()
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert [file.name for file in tmp_path.iterdir()] == ["clean.rrd"]
