"""MJX's questions about joints, answered as MJX answers them."""

import mujoco

from iswarm_mj.engines.mjx.api import body_of_positions, joint_of_positions, mjx, scan

XML = """<mujoco><worldbody>
  <body><freejoint/><geom size="1"/><body><joint type="ball"/><geom size="1"/></body></body>
  <body><joint type="slide"/><joint type="slide" axis="1 0 0"/><joint type="hinge"/><geom size="1"/></body>
  <body><geom size="1"/></body>
</worldbody></mujoco>"""


def test_answers_are_those_of_mjx():
    model = mjx.put_model(mujoco.MjModel.from_xml_string(XML), impl="jax")
    assert body_of_positions(model).tolist() == scan._q_bodyid(model).tolist() == [1] * 7 + [2] * 4 + [3] * 3
    assert joint_of_positions(model).tolist() == scan._q_jointid(model).tolist() == [0] * 7 + [1] * 4 + [2, 3, 4]
