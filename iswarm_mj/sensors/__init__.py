"""What robots sense: light and the 32-bit messages it carries, walls, and the floor."""
