"""Observation of a run: verdicts, state changes and summaries, without influence on it."""
