"""Helpers for every package: arrays, units, errors, files, tables."""
