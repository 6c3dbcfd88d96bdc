"""MuJoCo's timers while they are switched off, and after."""

import mujoco

from iswarm_mj.engines.mujoco_library import without_timers


def test_timers_come_back():
    model = mujoco.MjModel.from_xml_string("<mujoco><worldbody><geom size='1'/></worldbody></mujoco>")
    data = mujoco.MjData(model)
    with without_timers():
        mujoco.mj_step(model, data)
    assert data.timer[0].duration == 0
    mujoco.mj_step(model, data)
    assert data.timer[0].duration > 0
