"""What wsnsim exchanges with other tools, and field data.

    field_data      tables of readings, nodes, tracks and links in (`wsnsim import`); from tables, by conventions
    ns3, sumo       mobility traces in (`wsnsim import`); traces: as streams of entries
    trajectories    what tracks become: CSV files and a scenario
    stonesoup       Stone Soup filters as trackers, results as Stone Soup tracks (extra `stonesoup`)

Nothing here is imported by the other packages but `cli`. Result tables leave by `wsnsim export`: `analysis.frames`.
"""
