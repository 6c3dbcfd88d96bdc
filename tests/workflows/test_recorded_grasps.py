"""`iswarm clean --record-grasps`: what the recording says of attempts is what happened to the balls."""

import re

import numpy as np
import pytest
from rerun.chunk import RrdReader
from support.small import SMALL

from iswarm_mj.commands.clean import Clean
from iswarm_mj.config.swarm import GripperConfig
from iswarm_mj.engines.mjx.settings import MjxSettings

MJX = {"engine": "mjx", "physics": MjxSettings(contact_capacity=2), "worlds": 2, "record_worlds": (1,), "robots": 30}
DYNAMIC = GripperConfig(resolution="dynamic", grasp_voltage=30.0, relative_humidity=50.0)


@pytest.mark.slow
@pytest.mark.parametrize("how", [{"engine": "planar"}, {"engine": "planar", "worlds": 3, "record_worlds": (1,)}, MJX])
def test_balls_that_were_lifted_are_held_from_the_step_on(tmp_path, capsys, how):
    """In a world of several and in compiled programs, too."""
    Clean(**how, gripper=DYNAMIC, arena=SMALL.arena, steps=40, out=tmp_path, record_grasps=25).run()
    states = np.load(tmp_path / "trajectory.npz")["ball_state"]
    chunks = RrdReader(tmp_path / "clean.rrd").stream().to_chunks()
    log = [row for c in chunks if c.entity_path == "/grasp/log" for row in c.to_record_batch().to_pylist()]
    assert len(log) == 25
    found = set()
    for row in log:
        after = int(row["sim_time"].total_seconds()) + 1
        ball, what = re.search(r"at ball (\d+): (.*) \(", row["TextLog:text"][0]).groups()
        before, now = states[after - 1, int(ball)], states[after, int(ball)]
        assert (before, now) == {"lifted": (0, 1), "not lifted": (0, 0), "released": (1, 2), "not released": (1, 1)}[
            what
        ]
        found.add(what)
    assert {"lifted", "not lifted"} <= found
