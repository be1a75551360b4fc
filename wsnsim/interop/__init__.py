"""What wsnsim exchanges with other tools.

    ns3, sumo       mobility traces in (`wsnsim import`)
    trajectories    what they become: CSV files and a scenario
    stonesoup       Stone Soup filters as trackers, results as Stone Soup tracks (extra `stonesoup`)

Nothing here is imported by the other packages but `cli`. Result tables leave by `wsnsim export`: `analysis.frames`.
"""
