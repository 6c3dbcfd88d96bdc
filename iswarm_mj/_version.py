"""Version of the package, for the files that state it."""

__version__ = "0.2.0"
