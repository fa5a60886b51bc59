"""Audits of recorded runs against the reference interpreter."""
