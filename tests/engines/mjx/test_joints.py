"""Look-up of joints, against the private functions of MJX that it replaces."""

import mujoco

from iswarm_mj.engines.mjx.api import body_of_positions, joint_of_positions, mjx, scan

MODEL = """
<mujoco><worldbody>
  <body>
    <freejoint/><geom size="1"/>
    <body><joint type="ball"/><geom size="1"/></body>
  </body>
  <body>
    <joint type="slide"/><joint type="slide" axis="1 0 0"/><joint type="hinge"/><geom size="1"/>
  </body>
  <body><geom size="1"/></body>
</worldbody></mujoco>
"""
"""A free joint of 7 numbers, a ball joint of 4, and three joints of one number."""


def test_look_up_is_that_of_mjx():
    model = mjx.put_model(mujoco.MjModel.from_xml_string(MODEL), impl="jax")
    bodies = [1] * 7 + [2] * 4 + [3] * 3
    joints = [0] * 7 + [1] * 4 + [2, 3, 4]
    assert body_of_positions(model).tolist() == scan._q_bodyid(model).tolist() == bodies
    assert joint_of_positions(model).tolist() == scan._q_jointid(model).tolist() == joints
