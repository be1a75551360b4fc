"""The figures of the papers, ours: a module a paper, a function a figure."""
