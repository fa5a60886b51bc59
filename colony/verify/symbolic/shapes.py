"""Possible values of numbers in memory, found by encoding a frame repeatedly.

Each number is first assumed to keep its initial value. The values that the frame then gives it are added, and
ends that move are given up, until nothing new is added: the result is preserved by every frame. It is mostly
too wide, as one wide number widens others; so the search narrows once, to the values then written to memory,
and takes those if they are preserved as well.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

from colony.verify.symbolic.builder import Builder, Shape
from colony.verify.symbolic.cases import hull
from colony.verify.symbolic.logic import is_true
from colony.verify.symbolic.memory import shape_of
from colony.verify.symbolic.numbers import bounds_apart
from colony.verify.symbolic.system import Bounds, System

Attempt = Callable[[Mapping[str, Shape]], tuple[Builder, System]]
"""An encoder with memory of given shapes, by name; other memory keeps its first shape."""

DESCENTS = 3
"""Number of times that the values written to memory may turn out slightly too narrow."""


def settled(attempt: Attempt) -> System:
    """Return the system whose shapes of memory are preserved by every frame."""
    shapes: dict[str, Shape] = {}
    while True:
        builder, system = attempt(shapes)
        wider = _wider(builder)
        if not wider:
            break
        shapes |= {name: _given_up(old, new) for name, (old, new) in wider.items()}
    narrower = shapes | _written(builder)
    if narrower == shapes:
        return system
    tighter = _descended(attempt, narrower)
    return system if tighter is None else tighter


def _descended(attempt: Attempt, shapes: dict[str, Shape]) -> System | None:
    for _ in range(DESCENTS):
        builder, system = attempt(shapes)
        wider = _wider(builder)
        if not wider:
            return system
        shapes |= {name: new for name, (_, new) in wider.items()}
    return None


def _written(builder: Builder) -> dict[str, Shape]:
    """Return, for memory that changes, its initial shape and what is written to it, taken to be finite."""
    found = {}
    for name, (start, _, _) in builder.held.items():
        if name in builder.shapes:
            first = shape_of(start)
            found[name] = Shape(first.nan, first.infinite, _needed(builder, name).bounds)
    return found


def _needed(builder: Builder, name: str) -> Shape:
    """Return the values of a number in memory: its initial value, and those that a frame changes it to."""
    start, old, after = builder.held[name]
    bounds, apart = start.bounds, bounds_apart(after, old)
    if apart is not None:
        bounds = apart if is_true(start.nan) else hull(bounds, apart)
    before, new = shape_of(old), shape_of(after)
    return Shape(before.nan or new.nan, before.infinite or new.infinite, bounds)


def _wider(builder: Builder) -> dict[str, tuple[Shape, Shape]]:
    """Return memory whose shape was too narrow: that shape, and a wider one."""
    found = {}
    for name, (start, _, _) in builder.held.items():
        assumed, needed = builder.shapes.get(name, shape_of(start)), _needed(builder, name)
        bounds = hull(assumed.bounds, needed.bounds)
        joined = Shape(assumed.nan or needed.nan, assumed.infinite or needed.infinite, bounds)
        if joined != assumed:
            found[name] = (assumed, joined)
    return found


def _given_up(assumed: Shape, needed: Shape) -> Shape:
    """Return `needed`, without the ends that moved."""
    old, new = assumed.bounds, needed.bounds
    low = new.low if new.low == old.low else None
    high = new.high if new.high == old.high else None
    return replace(needed, bounds=Bounds(low, high, new.whole))
