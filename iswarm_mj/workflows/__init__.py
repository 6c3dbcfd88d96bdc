"""Whole jobs: a cleaning run, trials on the bench, rollouts."""
