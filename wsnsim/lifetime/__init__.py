"""How long a network lives: quiet power, libraries of visits, batteries, sample paths."""
