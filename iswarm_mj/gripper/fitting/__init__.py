"""Fits of the gripper's laws to measured voltages and forces, without MuJoCo."""
