"""Sensing: the readings that sensors would take, their imperfections, and which nodes take them at each step."""
