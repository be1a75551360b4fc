"""Tests of campaigns on this machine."""
