"""Swarms in motion: states, control steps, runs."""
