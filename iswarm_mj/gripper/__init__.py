"""The electrostatic gripper: force laws, their plugins in MuJoCo, the bench of one ball, and balls in the swarm."""
