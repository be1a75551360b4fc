"""Jiang, Song, Lin (2013): PSO-MHPF, IPF and PPF."""
