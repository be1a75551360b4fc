"""The version of this package: the only place where it is written. The build reads it from here."""

__version__ = "0.2.0"
RELEASED = "2026-11-23"
"""The date of this version."""
