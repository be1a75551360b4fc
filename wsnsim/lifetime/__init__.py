"""How long a network lives: simulated visits, quiet power, and sample paths of years."""
