"""The palette of figures, pictures and recordings, which the colour-blind can tell apart.

The colours are those of Okabe and Ito (2008), and shades of them.
"""

BLUE = "#0072b2"
ORANGE = "#d55e00"
GREEN = "#009e73"
YELLOW = "#e69f00"
PURPLE = "#aa4499"
SKY = "#56b4e9"
PINK = "#cc79a7"
PALE_GREEN = "#88ccbb"
PALE_ORANGE = "#e8b0a0"
RED = "#cc0000"
DARK = "#333333"
GREY = "#9aa0a8"
PALE = "#cdd2da"

# Robots by their states.
EMPTY = ORANGE
LOADED = BLUE
SCOUT = GREEN

# The arena and what lies in it.
FLOOR = "#e2e2de"
WALL = "#787c82"
DUMP = "#facd32"
DUST = "#cdc3af"
BOX = "#8a6d4f"

Rgb = tuple[int, int, int]
"""Red, green and blue, 0 to 255."""


def rgb(colour: str) -> Rgb:
    """Return red, green and blue of a colour "#rrggbb"."""
    red, green, blue = bytes.fromhex(colour[1:])
    return red, green, blue
