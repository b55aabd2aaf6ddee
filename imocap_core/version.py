"""The version of the program; CITATION.cff has it too."""

__version__ = "1.0.0"
