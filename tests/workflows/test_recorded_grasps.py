"""`iswarm clean --record-grasps`: attempts in the recording are what happened to the balls."""

import re

import numpy as np
import pytest
from rerun.chunk import RrdReader
from support.small import SMALL

from iswarm_mj.commands.clean import Clean
from iswarm_mj.config.swarm import GripperConfig
from iswarm_mj.engines.mjx.settings import MjxSettings

DYNAMIC = GripperConfig(resolution="dynamic", grasp_voltage=30.0, relative_humidity=50.0)
ONE_WORLD = {"engine": "planar"}
SECOND_OF_THREE_WORLDS = {"engine": "planar", "worlds": 3, "record_worlds": (1,)}
COMPILED = {
    "engine": "mjx",
    "engine_plugin": MjxSettings(contact_capacity=2),
    "worlds": 2,
    "record_worlds": (1,),
    "robots": 30,
}
LYING = 0
HELD = 1
DELIVERED = 2
STATES_OF_OUTCOME = {
    "lifted": (LYING, HELD),
    "not lifted": (LYING, LYING),
    "released": (HELD, DELIVERED),
    "not released": (HELD, HELD),
}
"""States of the ball before and after a step with an attempt of this outcome."""
N_ATTEMPTS = 25


@pytest.mark.slow
@pytest.mark.parametrize("options", [ONE_WORLD, SECOND_OF_THREE_WORLDS, COMPILED])
def test_balls_that_were_lifted_are_held_from_the_step_on(tmp_path, capsys, options):
    command = Clean(
        **options,
        gripper=DYNAMIC,
        arena=SMALL.arena,
        steps=40,
        out=tmp_path,
        record_grasps=N_ATTEMPTS,
    )
    command.run()
    states = np.load(tmp_path / "trajectory.npz")["ball_state"]
    log = []
    for chunk in RrdReader(tmp_path / "clean.rrd").stream().to_chunks():
        if chunk.entity_path == "/grasp/log":
            log += chunk.to_record_batch().to_pylist()

    assert len(log) == N_ATTEMPTS
    outcomes = set()
    for row in log:
        step = int(row["sim_time"].total_seconds()) + 1
        match = re.search(r"at ball (\d+): (.*) \(", row["TextLog:text"][0])
        ball = int(match[1])
        outcome = match[2]
        assert (states[step - 1, ball], states[step, ball]) == STATES_OF_OUTCOME[outcome]
        outcomes.add(outcome)
    assert {"lifted", "not lifted"} <= outcomes
