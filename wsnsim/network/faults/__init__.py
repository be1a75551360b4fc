"""Faults: their schedule, what each mechanism does, and the services that mechanisms use."""
