"""Li, Jiang, Zhang, Zhang (2012): GMTT, TSSTP and Cluster in a network that sleeps."""
