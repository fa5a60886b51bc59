"""Recordings of runs: writing, reading and replaying them as JSON lines or MCAP."""
