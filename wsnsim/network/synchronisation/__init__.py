"""Time synchronisation in simulated time: its mechanisms, what they may use, and the measured errors of clocks."""
