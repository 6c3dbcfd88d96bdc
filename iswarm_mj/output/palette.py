"""The palette of figures, pictures and recordings, which the colour-blind can tell apart (Okabe and Ito 2008)."""

BLUE, ORANGE, GREEN, YELLOW, PURPLE = "#0072b2", "#d55e00", "#009e73", "#e69f00", "#aa4499"
SKY, PINK, PALE_GREEN, PALE_ORANGE = "#56b4e9", "#cc79a7", "#88ccbb", "#e8b0a0"
RED, DARK, GREY, PALE = "#cc0000", "#333333", "#9aa0a8", "#cdd2da"
EMPTY, LOADED, SCOUT = ORANGE, BLUE, GREEN
"""Robots by their states."""
FLOOR, WALL, DUMP, DUST, BOX = "#e2e2de", "#787c82", "#facd32", "#cdc3af", "#8a6d4f"
"""The arena and what lies in it."""

Rgb = tuple[int, int, int]


def rgb(colour: str) -> Rgb:
    """Return red, green and blue, 0 to 255."""
    red, green, blue = bytes.fromhex(colour[1:])
    return red, green, blue
