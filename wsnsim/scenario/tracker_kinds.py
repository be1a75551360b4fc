"""The table of all built-in trackers: name, class and description, as strings; nothing is imported."""

from __future__ import annotations

from typing import Final

from wsnsim.scenario.roles import JIANG, LI, LIU, RUAN, WEI, Kind


def _tracker(
    kind: str, path: str, idea: str, paper: str = "", *, messages: str = "a reading up per member", **more: str
) -> Kind:
    return Kind(kind, path, idea, paper, messages=messages, **more)


TRACKERS: Final = (
    _tracker("pso_mhpf", "wsnsim.trackers.pso_mhpf:PsoMhpf",
        "particle filter on the members; a swarm move with a Metropolis-Hastings test replaces resampling", JIANG,
        state="particles on the active members; mean and covariance in the head",
        messages="a local estimate up per member; moved particles when membership changes",
        variants="measurements own|all, acceptance gaussian|transition|likelihood, "
        "prior_fit weighted|unweighted, ranking weight|likelihood, random_factors, "
        "step_length one|dt, estimate_when after|before, resample_first, resample_always, "
        "fusion share|inverse_variance, feedback, handover particles|gaussian"),
    _tracker("ipf", "wsnsim.trackers.information_pf:InformationPf",
        "particle filter in the head whose proposal is the update of an extended Kalman filter", JIANG,
        state="particles in the head, each with a covariance",
        variants="proposal per_particle|local|cloud, handover particles|gaussian"),
    _tracker("ppf", "wsnsim.trackers.parallel_pf:ParallelPf",
        "bootstrap particle filter split evenly over the members; the head sends resampling counts", JIANG,
        state="particles on the active members; mean, covariance and weights in the head",
        messages="readings up and down; weights and a mean up; counts down and surplus particles when resampling",
        variants="measurements all|own, handover particles|gaussian"),
    _tracker("central_pf", "wsnsim.trackers.centralised:CentralPf",
        "bootstrap particle filter in the head, on all readings: a reference", JIANG,
        state="particles in the head",
        variants="handover particles|gaussian"),
    _tracker("rkf", "wsnsim.trackers.relay_kalman:RelayKalman",
        "one Kalman filter that weights each reading by the probability that it comes from the target", LIU,
        state="mean, covariance and one probability per sensor, in the head",
        variants="spread false|true"),
    _tracker("imsf", "wsnsim.trackers.interacting_kalman:InteractingKalman",
        "one Kalman filter per sensor, mixed at each step by a Markov chain over the sensors", LIU,
        state="mean, covariance and probability of one filter per sensor, in the head",
        variants="mixing corrected|printed"),
    _tracker("pf", "wsnsim.trackers.sir:Sir",
        "the textbook particle filter, which resamples at every step", f"{WEI}; {RUAN}",
        state="particles in the head",
        variants="handover particles|gaussian"),
    _tracker("cs_pf", "wsnsim.trackers.cuckoo_pf:CuckooPf",
        "particle filter with a cuckoo search for resampling: Lévy flights and replaced nests", WEI,
        state="particles in the head",
        variants="variant literal|resample_first|metropolis, alpha random|fixed, fitness gaussian|absolute, "
        "move all|position, handover particles|gaussian"),
    _tracker("ics_pf", "wsnsim.trackers.cuckoo_pf:ImprovedCuckooPf",
        "cuckoo search particle filter; step length and replacement shrink over the generations", WEI,
        state="particles in the head",
        variants="variant literal|resample_first|metropolis, fitness gaussian|absolute, move all|position, "
        "handover particles|gaussian"),
    _tracker("gpf", "wsnsim.trackers.gaussian_pf:GaussianPf",
        "Gaussian particle filter: particles are sampled from a Gaussian and weighted, never resampled", RUAN,
        state="mean and covariance in the head"),
    _tracker("pso_gpf", "wsnsim.trackers.gaussian_pf:SwarmGaussianPf",
        "Gaussian particle filter; a swarm move of the predicted particles precedes the weighting", RUAN,
        state="mean and covariance in the head",
        variants="move position|all"),
    _tracker("gsa_gpf", "wsnsim.trackers.gaussian_pf:GravitationalGaussianPf",
        "Gaussian particle filter; a gravitational search of the predicted particles precedes the weighting", RUAN,
        state="mean and covariance in the head",
        variants="acceptance always|greedy, move position|all"),
    _tracker("ekf", "wsnsim.trackers.ekf:ExtendedKalman",
        "extended Kalman filter in the head, on all readings or the nearest sensor's: a reference",
        state="mean and covariance in the head",
        messages="a reading up per member; or a poll down and a reading up, of the nearest",
        variants="readings all|nearest, iterations"),
    _tracker("ukf", "wsnsim.trackers.ukf:UnscentedKalman",
        "unscented Kalman filter in the head, on all readings: sigma points instead of slopes",
        "Julier, Uhlmann (2004)",
        state="mean and covariance in the head"),
    _tracker("ckf", "wsnsim.trackers.ckf:CubatureKalman",
        "cubature Kalman filter in the head, on all readings: sigma points of the third degree",
        "Arasaratnam, Haykin (2009)",
        state="mean and covariance in the head"),
    _tracker("information_driven", "wsnsim.trackers.information_driven:InformationDriven",
        "a near-exact filter in the head; members send readings that are worth their energy",
        state="a mixture of Gaussians, mostly of one, and the members' plan, in the head",
        messages="a plan down when the last no longer fits; readings up, of those that it asks for"),
    _tracker("imm", "wsnsim.trackers.imm:InteractingModels",
        "interacting multiple models: a Kalman filter per motion model, mixed by a Markov chain",
        "Blom, Bar-Shalom (1988)",
        state="mean, covariance and probability of one filter per motion model, in the head",
        variants="models"),
    _tracker("grid", "wsnsim.trackers.grid:GridFilter",
        "the posterior of a scalar state, integrated on a grid: a reference",
        state="a density on a grid, in the head"),
    _tracker("trilateration", "wsnsim.trackers.trilateration:Trilateration",
        "the weighted centroid of the circles' intersections, without memory: a baseline", RUAN,
        state="the last position"),
    _tracker("gmtt", "wsnsim.trackers.grey:GreyTracking",
        "least-squares fixes from ranges; a grey model of the last fixes predicts the next", LI,
        state="the last fixes with their times, in the head",
        variants="predictor grey|linear, correction tail|literal|none, report fix|prediction, shift, window"),
    _tracker("tsstp", "wsnsim.trackers.markov:TwoPhase",
        "least-squares fixes from ranges; the last fix is the prediction", f"Ren, Li, Gao, Cheng (2009), after {LI}",
        state="the last two fixes, in the head"),
    _tracker("cluster", "wsnsim.trackers.mixture_pf:MixturePf",
        "Rao-Blackwellised particle filter: particles for the turns, Kalman filters for the state",
        f"Yang, Xing, Shi, Pan (2007), after {LI}",
        state="modes, each with a Kalman filter, in the head"),
    _tracker("ris", "wsnsim.trackers.awake_only:AwakeOnly",
        "least-squares fixes from the ranges of awake nodes, without prediction or memory", LI,
        state="the last fix, in the head"),
)  # fmt: skip
