"""Verification: the reference interpreter, proofs, lints, comparisons and audits."""
