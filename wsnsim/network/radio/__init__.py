"""How a burst travels: topology, channel access, the channel, reception, fragmentation, routing and transport."""
