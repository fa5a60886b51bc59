"""Proofs of contracts in every possible frame: proved, proved in time, refuted by a trace, or unknown."""
