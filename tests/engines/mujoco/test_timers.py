"""MuJoCo's timers, switched off and on again."""

import mujoco

from iswarm_mj.engines.mujoco_library import without_timers

MODEL = "<mujoco><worldbody><geom size='1'/></worldbody></mujoco>"


def test_timers_come_back():
    model = mujoco.MjModel.from_xml_string(MODEL)
    data = mujoco.MjData(model)
    with without_timers():
        mujoco.mj_step(model, data)
    assert data.timer[0].duration == 0

    mujoco.mj_step(model, data)
    assert data.timer[0].duration > 0
