"""The engine of tests that need no worker processes."""

from wsnsim.campaign.serial_engine import SerialEngine

InlineEngine = SerialEngine
