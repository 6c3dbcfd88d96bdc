"""Senses of robots: light and the 32-bit messages it carries, walls, and the floor."""
