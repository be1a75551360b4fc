"""Words of the field for what wsnsim calls otherwise: kinds, keys, commands and columns. Suggestions use them.

    meant_by("unscented kalman filter", ["ekf", "ukf"]) -> ["ukf"]

A line of a table is what a user may write, and the names that it may mean, the likeliest first. Words are compared in
lower case, with '_' for spaces, hyphens and dots.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator
from typing import Final

_TRACKERS: Final = """
kalman, kf, kalman_filter: ekf ukf ckf imm rkf
extended_kalman, extended, ekf_tracker, iterated_kalman, iekf, linearised_kalman: ekf
unscented, unscented_kalman, sigma_point, spkf, sigma_points: ukf ckf
cubature, cubature_kalman: ckf
particle, particles, particle_filter, bootstrap, sir, smc, monte_carlo, sequential_monte_carlo, bpf: pf central_pf
gaussian_particle, gaussian_particle_filter, gaussian_pf: gpf
rao_blackwell, rao_blackwellised, rao_blackwellized, rbpf, marginalised, marginalized: cluster
multiple_model, interacting_multiple_model, mode, modes, manoeuvring, maneuvering, multimodel: imm
multilateration, least_squares, triangulation, centroid, localisation, localization: trilateration ris
pso, swarm, particle_swarm, metropolis_hastings, mcmc: pso_mhpf pso_gpf
gravitational, gsa, gravity: gsa_gpf
cuckoo, cuckoo_search, levy: cs_pf ics_pf
information_filter, sensor_selection, information_gain, fisher: information_driven ipf
histogram_filter, point_mass, grid_filter, bayes, discrete: grid
grey_model, gray_model, gm, gm_1_1, grey, gray: gmtt
distributed_pf, distributed, parallel: ppf pso_mhpf
"""
_MODELS: Final = """
turn_rate, omega, yaw_rate, angular_rate, angular_velocity: turn turn_q start
constant_turn, ct, ctrv, turn, arc, circular, circle, coordinated: coordinated_turn
cv, ncv, nearly_constant_velocity, near_constant_velocity, linear, uniform_motion, straight: constant_velocity
ca, nca, acceleration, wiener: constant_acceleration
singer, ornstein_uhlenbeck, ou, correlated, mean_reverting: gauss_markov
rwp, random_walk, random_motion, mobility: random_waypoint gauss_markov
way_points, route, path_of_points, legs, polyline: waypoints
trace, trajectory, gps_track, recorded_trajectory, ns3, sumo, mobility_trace, csv_track: recorded_track waypoints
camera, aoa, doa, direction, direction_of_arrival, angle, azimuth, angle_of_arrival, los, optical: bearing range_bearing
radar, polar, sonar, lidar: range_bearing range
distance, toa, tof, ranging, uwb, time_of_arrival, time_of_flight, ultrasonic, ultrasound: range
tdoa, time_difference_of_arrival: range
signal_strength, received_power, rss, ble, bluetooth, wifi, power_of_signal: rssi
acoustic, sound, microphone, energy_detector, loudness: acoustic_energy
gps, gnss, position_sensor, cartesian, xy: coordinate recorded_track file
binary, detection_sensor, proximity, presence, pir: range
recorded_readings, dataset, measurements_file, replayed: recorded
random, poisson, uniformly, binomial: uniform
lattice, regular, mesh: grid jittered_grid
csv, from_file, positions, coordinates, node_file, layout: file anchors
fixed, static, list, given: anchors file
gaussian, normal: around_truth
"""
_NETWORK: Final = """
unit_disk, unit_disc, disc, udg, udgm, protocol_model: disk
shadowing, lognormal, path_loss, pathloss, fading, zuniga, log_distance: log_normal
k7, testbed, pdr_trace, measured_links: recorded
wifi_mac, 802_15_4, ieee802154, csma_ca, csmaca, contention, zigbee, unslotted, carrier_sense, aloha: csma
slots, time_division, leach_mac: tdma
low_power_listening, lpl, preamble_sampling, bmac, b_mac, x_mac: xmac contikimac
contiki, contiki_mac: contikimac
channel_hopping, 6tisch, time_slotted, orchestra: tsch
perfect_mac, no_mac, null_mac: ideal
duty, dutycycle, duty_cycling, duty_cycled, periodic_sleep, cycle: duty_cycle
random_sleep, sleep_probability, rand_sleep: ris
never_sleep, no_sleep, awake, on: always_on
wake_on_event, event_driven, wor: event_wake
shortest_path, dijkstra, hops, hop_count, bfs: minimum_hop minimum_energy
geographic, gpsr, greedy, position_based: greedy_geographic
collection_tree, tree, rpl, etx, gradient: ctp
heinzelman, leach, radio_model, bits: first_order first_order_2002
datasheet, cc2420, state_machine, power_states, telos, tmote, power_state: states
time_synchronisation, time_synchronization, clock_sync, synchronisation, synchronization, rbs, tpsn: ftsp sync
skew, clock_drift, offset_drift: drift
base_station, gateway, bs, server, fusion_centre, fusion_center: sink node central
cluster_head, head, leader, ch, election: clusters strongest_signal central
dynamic_cluster, leader_election: strongest_signal moving_head
centralised, centralized: central central_pf
failure, failures, node_failure, crash_fault, outage, kill: crash fault faults
jam, jamming, jammer, interference: blackout
packet_loss, drop, loss_rate, per: link_loss loss
aggregation, packing_frames: frames
prediction, predictive_wakeup, flood, flooding, gossip: directed_flood region
"""
_KEYS: Final = """
mobility, motion_model, target, movement, dynamics, process_model, kinematics: motion targets
measurement, observation, measurement_model, sensing, observation_model, sensors: sensor
deployment, nodes, placement, topology, layout, field: deploy
channel, propagation, radio, phy, link_model: link
medium_access, mac_protocol, channel_access: mac
battery, energy_model, power_model, radio_energy: battery energy energy_left
charge, capacity, initial_energy, energy_initial: battery energy_initial
noise, noise_sd, std, stddev, standard_deviation, sigma, measurement_noise, stdev, error: sd sigma0 noise variance q
variance_of_noise, r, measurement_variance: variance sd
process_noise, intensity, qc, noise_intensity: q noise_scale variances sigma0
range, radius, sensing_range, communication_range, max_range, sensing_radius, comm_range, detection_range: reach
n, count, node_count, number_of_nodes, num_nodes, n_nodes, number: nodes
particles_number, n_particles, num_particles, np, number_of_particles, samples: particles
runs, monte_carlo_runs, mc_runs, trials, repetitions, repeats, n_runs: replicates
time_step, dt, sampling_interval, sampling_period, period_of_sampling, sample_time, timestep: step
sim_time, simulation_time, length_of_run, end_time, t_end, horizon, total_time, stop_time: duration
random_seed, rng, rng_seed: seed
initial_state, x0, start_state, state, initial_position, init: start
initial_covariance, p0, prior_sd, initial_uncertainty, initial: sd prior
path_loss_exponent, pathloss_exponent, alpha_loss, attenuation: exponent eta decay
tx_power, transmit_power, output_power: power
data_rate, bit_rate, bitrate, baud: rate
filter, estimator, algorithm, strategy, method, tracking: tracker
include, inherits, base, parent, template, import: extends
filename, filepath, csv_file, file, path_to_file: path
size, area, area_width, xmax: width height
log, logging, output, tables: record
cycle_length, interval_length, wake_interval, cycle_time: interval period
awake_fraction, duty_fraction, on_share, on_time: awake_share
time, run_time, length: duration
retries, retransmissions, max_retransmissions: max_retries retries
speed, velocity, v0: speed mean start
process_noise_scale, inflation, noise_factor: noise_scale
"""
_COMMANDS: Final = """
simulate, sim, start, exec, execute, go: run
lint, validate, verify_scenario, test: check
help, describe, show, explain, doc, docs, man, what: info
init, create, generate, template, scaffold, plugin: new
bench, benchmark, contrast, versus, vs, rank: compare
grid, batch, vary, parameter_study, optimise, optimize: sweep
resume, continue, campaign: sweep collect
html, page, replay, view, visualise, visualize, animate: report
csv, parquet, convert, save, dump, matlab: export
graph, figure, draw, chart: plot
debug, log, events, explain_step, step: trace
repeat, rerun, check_result: verify
kinds, ls, catalog, catalogue, models, components: list
calibrate, estimate, regress: fit
papers, paper, replicate: reproduce
merge, gather, join: collect
live, monitor, follow: watch
"""
_ARGUMENTS: Final = """
jobs, n_jobs, processes, cores, threads: workers
output, outfile, out_file, to: out
override, set, settings, changes, params, parameters: overrides
save_tables, store, recorded_tables: keep record
"""
_COLUMNS: Final = """
rms, rms_error, root_mean_square, position_rmse, mse, accuracy: rmse median_error
position_error, estimation_error, distance_error: error rmse
pdr, packet_delivery_ratio, delivery, delivery_ratio: delivered frames_lost
latency, end_to_end_latency, e2e, delay_to_sink: delay report_delay
lifetime, network_lifetime, fnd, first_node_death: first_death half_dead
hnd, half_node_death: half_dead
joule, joules, consumption, energy_consumption, total_energy, energy_used: energy joules
residual, residual_energy, remaining_energy, charge_left: energy_left
retransmission, resent, resends: retries
collisions: collided
lost_tracks, track_loss, divergence, lost_track: lost losses lost_share
runtime, wall_time, cpu, cpu_time: cpu_seconds
run, run_number, monte_carlo_run: replicate
t, timestamp, simulation_time: time
x, pos_x, position_x, px: px x
y, pos_y, position_y, py: py y
velocity_x, speed_x, vel_x: vx
velocity_y, speed_y, vel_y: vy
cov, covariance, uncertainty, std_x, sigma_x: sd_x cov_xy
anees, consistency, normalised_estimation_error: nees
head_node, leader_node: head
"""
FILLERS: Final = (
    "model",
    "filter",
    "sensor",
    "tracker",
    "motion",
    "mac",
    "protocol",
    "kind",
    "the",
    "m",
    "s",
    "hz",
    "dbm",
)
"""Words that a name may have more than a line of the tables."""


def _read(*tables: str) -> dict[str, tuple[str, ...]]:
    read: dict[str, tuple[str, ...]] = {}
    for line in (line for text in tables for line in text.strip().splitlines()):
        words, _, names = line.partition(":")
        for word in words.split(", "):
            read[word] = (*read.get(word, ()), *names.split())
    return read


SYNONYMS: Final = _read(_TRACKERS, _MODELS, _NETWORK, _KEYS, _COMMANDS, _ARGUMENTS, _COLUMNS)


def meant_by(word: str, known: Collection[str]) -> list[str]:
    """Return the known names that a word may mean, the likeliest first; none if the tables have no such word."""
    by_form = {_form(name): name for name in sorted(known, reverse=True)}
    for form in _forms(word):
        names = [form, *SYNONYMS.get(form, ())]
        found = [by_form[name] for name in dict.fromkeys(names) if name in by_form]
        if found and _form(word) not in known:
            return found
    return []


def _forms(word: str) -> Iterator[str]:
    """Yield the word, then without fillers, then each of its own words."""
    form = _form(re.sub(r"(?<=[a-z])(?=[A-Z])", "_", word))
    pieces = form.split("_")
    yield form
    yield form.replace("_", "")
    yield form.removesuffix("s")
    yield "_".join(piece for piece in pieces if piece not in FILLERS)
    if len(pieces) > 1:
        yield from (piece for piece in pieces if piece not in FILLERS and len(piece) > 1)


def _form(word: str) -> str:
    return re.sub(r"[\s.\-/]+", "_", word.strip().lower())
