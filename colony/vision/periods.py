"""The periods of the scripts that process images."""

from __future__ import annotations

PERIOD_S = 0.25
"""Seconds between two images."""
