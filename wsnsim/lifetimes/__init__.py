"""How long a network lives: simulated visits, quiet power, batteries, and sample paths of years."""
