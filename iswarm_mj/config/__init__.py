"""Settings of a run: arena, drive, optics, gripper, strategy, energy."""
