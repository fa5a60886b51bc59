"""Moments of recordings, found quickly by an index of interpreter states."""
