"""Modules written in Python, for tests: each answers what its script says, call by call."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, ClassVar


class Scripted:
    """Gives `answers` in turn, calling those that can be called; `seen` is what it was given."""

    answers: ClassVar[list[Any]] = []
    seen: ClassVar[list[tuple[float, dict[str, object]]]] = []
    built: ClassVar[list[dict[str, float]]] = []

    def __init__(self, **params: float) -> None:
        self.built.append(params)
        self._next = 0

    def step(self, frame: Mapping[str, object]) -> object:
        self.seen.append((frame.t, dict(frame)))  # type: ignore[attr-defined]
        answer = self.answers[self._next]
        self._next += 1
        return answer(frame) if isinstance(answer, Callable) else answer  # type: ignore[arg-type]


class Unbuildable:
    def __init__(self) -> None:
        raise OSError("no such device")


class Leaving:
    def __init__(self) -> None:
        raise SystemExit(3)


class Pulses:
    """Commands in two of six frames of 50 ms."""

    def step(self, frame: Mapping[str, object]) -> object:
        return {"velocity": 1.0} if round(20 * frame.t) % 6 < 2 else None  # type: ignore[attr-defined]
