"""wsnsim: a discrete-event simulator of wireless sensor networks that track moving targets."""
