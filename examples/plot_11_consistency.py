"""
Is the filter consistent?
=========================

A filter says how uncertain it is. The normalised estimation error squared (NEES) compares this with its real error. Per
dimension its mean is 1 if the covariance is right, above 1 if the filter is overconfident. Here the filter assumes
less, the true, and more process noise than there is.
"""

import matplotlib.pyplot as plt

import wsnsim

figure, axes = plt.subplots(figsize=(7, 4), layout="constrained")
axes.axhline(1, color="black", linestyle=":", label="consistent")
for scale in (0.01, 1, 100):
    tracker = {"kind": "ukf", "assumes": {"noise_scale": scale}}
    result = wsnsim.run("bearing", tracker=tracker, replicates=12, duration="6 s")
    nees = result.estimates.groupby("time")["nees"].median()
    axes.semilogy(nees.index, nees, label=f"{scale:g} x the process noise")
axes.set(xlabel="time [s]", ylabel="median NEES per dimension, 12 runs")
axes.legend(loc="upper left")
plt.show()
