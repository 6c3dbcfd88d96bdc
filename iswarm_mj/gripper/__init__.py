"""The electrostatic gripper: force laws and what they decide."""
