"""The engine of tests that need no worker processes."""

from wsnsim.campaign.engines import SerialEngine

InlineEngine = SerialEngine
