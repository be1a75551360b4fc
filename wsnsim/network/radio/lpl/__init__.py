"""Low-power listening: when radios are on, who gets the channel, and the two protocols X-MAC and ContikiMAC."""
