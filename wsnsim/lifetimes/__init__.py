"""Lifetimes of networks: quiet power, libraries of simulated visits, and sample paths of years."""
