"""Optics: who hears whom, and the 32 bits that pass."""
