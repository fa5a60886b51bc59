"""The periods at which scripts look at images."""

from __future__ import annotations

PERIOD_S, THESIS_PERIOD_S = 0.25, 0.5
"""Seconds from one look to the next: ours, and as printed in the thesis."""
