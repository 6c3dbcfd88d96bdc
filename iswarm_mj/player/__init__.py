"""The page to play with: a swarm or the gripper's bench in a browser; and replays of runs."""
