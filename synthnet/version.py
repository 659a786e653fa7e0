"""Version of the software; versions of the dataset are recipes."""

__version__ = "0.1.0"
