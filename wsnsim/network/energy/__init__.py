"""What nodes spend and what they have left: consumption over time, sleep states, battery timers, energy by step."""
