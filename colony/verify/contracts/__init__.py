"""Proofs of contracts in every possible frame: proved, refuted by a trace, or unknown with the reason."""
