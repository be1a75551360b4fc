"""Liu, Wang (2012): RKF and IMSF along a line; it prints no number but two run times."""
