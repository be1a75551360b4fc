"""
A sweep of particles
====================

How many particles does a Gaussian particle filter need? Median per-run RMSE of twelve runs and a bootstrap interval
for each number of particles. With few, single runs lose the target, and the interval says so.
"""

import matplotlib.pyplot as plt
import numpy as np

import wsnsim
from wsnsim.trackers import Gpf

PARTICLES = [50, 100, 200, 400, 800]
rng = np.random.default_rng(0)
medians, low, high = [], [], []
for particles in PARTICLES:
    runs = wsnsim.run("jiang_field", tracker=Gpf(particles=particles), replicates=12, duration="4 s").runs
    resampled = np.median(rng.choice(runs["rmse"], size=(2000, len(runs))), axis=1)
    medians.append(runs["rmse"].median())
    low.append(np.quantile(resampled, 0.025))
    high.append(np.quantile(resampled, 0.975))

figure, axes = plt.subplots(figsize=(6, 4), layout="constrained")
axes.fill_between(PARTICLES, low, high, alpha=0.2, label="95 % interval of the median")
axes.plot(PARTICLES, medians, "o-", label="median of 12 runs")
axes.set(xscale="log", yscale="log", xlabel="particles", ylabel="per-run RMSE [m]")
axes.set_xticks(PARTICLES, PARTICLES)
axes.minorticks_off()
axes.legend()
plt.show()
