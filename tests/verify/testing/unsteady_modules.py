"""Modules in Python that do not do the same twice, and one that does."""

from __future__ import annotations

from collections.abc import Mapping


class Shared:
    """All objects of the class count together, so that each answers what the others left."""

    calls = 0

    def step(self, frame: Mapping[str, object]) -> object:
        Shared.calls += 1
        return {"v": float(Shared.calls)}


class Steady:
    """Each object counts for itself."""

    def __init__(self) -> None:
        self.calls = 0

    def step(self, frame: Mapping[str, object]) -> object:
        self.calls += 1
        return {"v": float(self.calls)}
