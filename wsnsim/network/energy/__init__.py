"""What nodes spend and what they have left: consumption over time, duty cycles, battery timers, energy by step."""
