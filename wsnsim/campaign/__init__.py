"""Campaigns: all Monte Carlo runs of a sweep in one folder, resumable and divisible.

    folder = prepare(load_sweep("particles"), "results/particles")   the manifest and the scenarios are on disk
    outcome = run_campaign(folder, LocalEngine(2))                   the missing tasks are run
    collect([Folder("a"), Folder("b")], Folder("all"))               the shards of other machines are merged

The folder holds all that a campaign needs to resume after any of its processes died; see `recording.folder`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from wsnsim.base.facades import facade

if TYPE_CHECKING:
    # fmt: off
    # isort: off
    from wsnsim.campaign.code_changes import differing_code as differing_code
    from wsnsim.campaign.engines import (
        WHOLE as WHOLE, CampaignOutcome as CampaignOutcome, CampaignProgress as CampaignProgress, Shard as Shard,
    )
    from wsnsim.campaign.folders import (
        collect as collect, demand_permitted as demand_permitted, describe_failed as describe_failed,
        describe_missing as describe_missing, existing_manifest as existing_manifest, missing as missing,
        needs_permission as needs_permission, prepare as prepare, reopen as reopen,
    )
    from wsnsim.campaign.runner import run_campaign as run_campaign

__getattr__, __dir__ = facade(__name__)
