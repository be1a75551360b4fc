"""What scripts and notebooks use: results as objects, and components in place of text.

    result = wsnsim.simulate("pso_mhpf", tracker=PsoMhpf(particles=200), seed=3)     one run, in memory
    result = wsnsim.run("pso_mhpf", replicates=30, out="results/x.h5")               many runs, in a file
    wsnsim.sweep("pso_mhpf", {"tracker.particles": [100, 400]}, out="results/sweep")
    wsnsim.compare("pso_mhpf", trackers=["ekf", PsoMhpf(particles=200)], replicates=20)

The root of the package hands these names on; the modules are imported at first use.
"""
