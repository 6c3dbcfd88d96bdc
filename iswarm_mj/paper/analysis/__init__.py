"""Statements and their tests, findings, statistics, and figures."""
