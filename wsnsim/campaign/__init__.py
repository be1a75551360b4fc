"""Campaigns: all Monte Carlo runs of a sweep in one folder, resumable and divisible.

    folder = prepare(load_sweep("particles"), "results/particles")   the manifest and the scenarios are on disk
    outcome = run_campaign(folder, LocalEngine(2))                   the missing tasks are run
    collect([Folder("a"), Folder("b")], Folder("all"))               the shards of other machines are merged

The folder holds all that a campaign needs to resume after any of its processes died; see `recording.folder`.
"""

from wsnsim.campaign.code_changes import differing_code
from wsnsim.campaign.engines import WHOLE, CampaignOutcome, CampaignProgress, Shard
from wsnsim.campaign.folders import (
    collect,
    demand_permitted,
    describe_missing,
    existing_manifest,
    missing,
    needs_permission,
    prepare,
    reopen,
)
from wsnsim.campaign.runner import run_campaign
from wsnsim.campaign.sweeping import sweep

__all__ = [
    "WHOLE",
    "CampaignOutcome",
    "CampaignProgress",
    "Shard",
    "collect",
    "demand_permitted",
    "describe_missing",
    "differing_code",
    "existing_manifest",
    "missing",
    "needs_permission",
    "prepare",
    "reopen",
    "run_campaign",
    "sweep",
]
