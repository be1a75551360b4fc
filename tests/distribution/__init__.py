"""Checks of what a user installs."""
