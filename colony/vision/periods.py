"""The periods of the scripts that process images."""

from __future__ import annotations

PERIOD_S, THESIS_PERIOD_S = 0.25, 0.5
"""Seconds between two images: Colony's, and the thesis's."""
