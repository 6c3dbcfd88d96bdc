"""The vector-based strategy with scouts: pure rules over a robot axis."""
