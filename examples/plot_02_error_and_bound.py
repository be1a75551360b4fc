"""
Error against the bound
=======================

How good is good enough? The Cramér-Rao lower bound is the error of an ideal filter with the same measurements. The
figure has the error of 20 Monte Carlo runs of a Gaussian particle filter over time, beside the bound.
"""

import matplotlib.pyplot as plt

import wsnsim
from wsnsim.trackers import Gpf

result = wsnsim.run("jiang_field", tracker=Gpf(particles=400), replicates=20, duration="6 s")

figure, axes = plt.subplots(figsize=(7, 4), layout="constrained")
result.plot.error(ax=axes)
axes.set(yscale="log", ylim=(0.05, 50))
axes.grid(which="both", color="#eeeeee")
plt.show()
