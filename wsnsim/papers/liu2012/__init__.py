"""Liu, Wang (2012): RKF and IMSF along a line."""
