"""Shapes of numbers in memory (ranges of their values), by abstract interpretation: widening, then narrowing.

Each number is first assumed to keep its initial value. A frame is encoded repeatedly; each time the values
that it writes are added and moving bounds are dropped, until every frame preserves the result. The result
is usually too wide, as one wide number widens others. So it is narrowed once, to the values written to
memory, and widened again until every frame preserves it. If that takes too many encodings, the wide result
stays. Shapes found for a similar program are a guess, which one encoding confirms.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

from colony.verify.symbolic.builder import SystemBuilder
from colony.verify.symbolic.cases import hull
from colony.verify.symbolic.logic import is_true
from colony.verify.symbolic.memory import shape_of
from colony.verify.symbolic.numbers import changed_bounds
from colony.verify.symbolic.system import ExtendedReal, NumberBounds, Shape, System

EncodeWithShapes = Callable[[Mapping[str, Shape]], tuple[SystemBuilder, System]]
"""A function that encodes a frame with given shapes of memory, by name; others keep their initial shape."""

_NONE: Mapping[str, Shape] = {}

MAX_STABILIZING_ENCODINGS = 3
"""Maximum number of encodings in which narrower shapes may become stable."""


def with_stable_shapes(
    encode_with: EncodeWithShapes, known: Mapping[str, Shape] = _NONE, guess: Mapping[str, Shape] = _NONE
) -> System:
    """Return the system whose shapes of memory are preserved by every frame.

    `known` are shapes that are known to be stable, and stay as they are; those with whole bounds change where
    a frame writes a number to them that is not whole. `guess` may be stable; it is tried first.
    """
    if guess:
        guessed = _narrowed(encode_with, {**guess, **known}, known)
        if guessed is not None:
            return guessed
    shapes = dict(known)
    while True:
        builder, system = encode_with(shapes)
        wider = _wider_shapes(builder, known)
        if not wider:
            break
        shapes |= {name: _without_moved_ends(old, new) for name, (old, new) in wider.items()}
    narrower = shapes | _written_shapes(builder) | {name: shapes[name] for name in known}
    if narrower == shapes:
        return system
    tighter = _narrowed(encode_with, narrower, known)
    return system if tighter is None else tighter


def _narrowed(
    encode_with: EncodeWithShapes, shapes: dict[str, Shape], known: Mapping[str, Shape]
) -> System | None:
    for _ in range(MAX_STABILIZING_ENCODINGS):
        builder, system = encode_with(shapes)
        wider = _wider_shapes(builder, known)
        if not wider:
            return system
        shapes |= {name: new for name, (_, new) in wider.items()}
    return None


def _written_shapes(builder: SystemBuilder) -> dict[str, Shape]:
    """Return the shapes of changing memory according to the values written to it, assumed to be finite."""
    found = {}
    for name, (start, _, _) in builder.numbers_in_memory.items():
        if name in builder.shapes:
            initial = shape_of(start)
            found[name] = Shape(initial.nan, initial.infinite, _needed_shape(builder, name).bounds)
    return found


def _needed_shape(builder: SystemBuilder, name: str) -> Shape:
    """Return the shape of a number's initial value and of the values that a frame changes it to."""
    initial, old, new = builder.numbers_in_memory[name]
    bounds, changed = initial.bounds, changed_bounds(new, old)
    if changed is not None:
        bounds = changed if is_true(initial.nan) else hull(bounds, changed)
    before, after = shape_of(old), shape_of(new)
    return Shape(before.nan or after.nan, before.infinite or after.infinite, bounds)


def _wider_shapes(builder: SystemBuilder, known: Mapping[str, Shape]) -> dict[str, tuple[Shape, Shape]]:
    """Return the shapes that are too narrow, each with a wider one."""
    found = {}
    for name, (start, _, new) in builder.numbers_in_memory.items():
        if name in known and known[name] == builder.shapes[name] and _fits(new, known[name]):
            continue
        assumed, needed = builder.shapes.get(name, shape_of(start)), _needed_shape(builder, name)
        bounds = hull(assumed.bounds, needed.bounds)
        joined = Shape(assumed.nan or needed.nan, assumed.infinite or needed.infinite, bounds)
        if joined != assumed:
            found[name] = (assumed, joined)
    return found


def _fits(new: ExtendedReal, shape: Shape) -> bool:
    """Return True unless a cell of whole numbers would be written another one."""
    return new.bounds.whole or not shape.bounds.whole


def _without_moved_ends(assumed: Shape, needed: Shape) -> Shape:
    """Return `needed` without the bounds that moved."""
    old, new = assumed.bounds, needed.bounds
    low = new.low if new.low == old.low else None
    high = new.high if new.high == old.high else None
    return replace(needed, bounds=NumberBounds(low, high, new.whole))
