"""
Nodes that fail
===============

At 4 s a part of the nodes crashes, for two seconds. The target, the network and the noise are the same in all runs, so
that every difference is due to the crash.
"""

import matplotlib.pyplot as plt

import wsnsim

figure, axes = plt.subplots(figsize=(7, 4), layout="constrained")
axes.axvspan(4, 6, color="lightgrey", label="nodes are down")
for fraction in (0.0, 0.5, 0.9):
    crash = {"kind": "crash", "at": "4 s", "duration": "2 s", "fraction": fraction}
    result = wsnsim.simulate("jiang_field", tracker="ckf", duration="10 s", faults=[crash] if fraction else [])
    estimates = result.estimates
    axes.semilogy(estimates["time"], estimates["error"], label=f"{fraction:.0%} of the nodes")
axes.set(xlabel="time [s]", ylabel="position error [m]")
axes.legend(loc="upper left")
plt.show()
