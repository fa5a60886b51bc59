"""Whole numbers in memory that stay within bounds: in their range floats are exact, so proofs need no reals.

Abstract interpretation (`symbolic/shapes.py`) loses the bounds of `if n == 100 then 0 else n + 1`. So cells
that begin whole are guessed to be whole and small, which makes what is computed of them exact; with that,
bounds are proved by induction (`candidates.py`). A guess without a proof is dropped, and the others are
proved anew: the proofs of all that stay hold together, for floats, bit for bit. Where frames are regular, a
counter is also bounded by the number of frames in the longest run.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from fractions import Fraction

import z3

from colony.execute.validity import MAX_TIME_NS
from colony.ir.program import Program, gaps_ns
from colony.verify.contracts.candidates import (
    Candidate,
    Invariants,
    candidates,
    invariants,
    numeral,
    numerals,
)
from colony.verify.contracts.results import ProofOptions
from colony.verify.contracts.slicing import cone_of
from colony.verify.contracts.solver import Budget, Deadline
from colony.verify.symbolic import unrolling
from colony.verify.symbolic.encode import encode
from colony.verify.symbolic.numbers import EXACT_WHOLE, finite
from colony.verify.symbolic.system import ContractFormula, NumberBounds, Shape, SymbolicCell, System
from colony.verify.symbolic.unrolling import rounding_reasons

_MAX_BOUNDS = 24
"""Number of constants that are tried as bounds of a cell."""

_MAX_STEPS = 4
"""Number of constants that are tried as steps of a cell."""

_MAX_GUESSES = 100

_SHARE = 0.05
"""Share of a contract's budget for each cell."""

_GUESS = Shape(nan=False, infinite=False, bounds=NumberBounds(-EXACT_WHOLE / 2, EXACT_WHOLE / 2, whole=True))


def whole_numbers(
    program: Program, system: System, options: ProofOptions, deadline: Deadline | None
) -> dict[str, Shape]:
    """Return proved shapes of cells that stay whole and bounded, which `system`, of `program`, does not know.

    Only cells that a contract depends on which rounds are tried.
    """
    guessed = dict.fromkeys(_unbounded(system), _GUESS)
    while guessed:
        trial = encode(program, known=guessed)
        kept = {name: _GUESS for name in guessed if trial.shapes.get(name) == _GUESS}
        if len(kept) == len(guessed):  # nothing is written to them that is not whole
            kept = _proved(trial, kept, options, deadline)
            if len(kept) == len(guessed):
                return kept
        guessed = dict.fromkeys(kept, _GUESS)
    return {}


def _unbounded(system: System) -> list[str]:
    """Return the numbers in memory that begin whole, and are not known to stay whole and small."""
    rounded = [claim for claim in system.claims if rounding_reasons([claim])]
    cone = cone_of(system, *rounded)
    return [
        cell.name
        for cell in cone.cells
        if cell.name in system.shapes and _is_whole(cell.initial) and not _is_small(system.shapes[cell.name])
    ]


def _is_whole(value: z3.ExprRef) -> bool:
    return bool(z3.is_int_value(value) or (z3.is_rational_value(value) and value.denominator_as_long() == 1))


def _is_small(shape: Shape) -> bool:
    low, high, whole = shape.bounds.low, shape.bounds.high, shape.bounds.whole
    return whole and not shape.infinite and low is not None and high is not None


def _proved(
    system: System, names: Collection[str], options: ProofOptions, deadline: Deadline | None
) -> dict[str, Shape]:
    """Return the shapes of the cells that are proved to stay whole and bounded, given all of `names`."""
    found = {}
    for cell in system.cells:
        if cell.name in names:
            bounds = _bounds(system, cell, Budget(options, deadline, _SHARE))
            if bounds is not None:
                found[cell.name] = Shape(nan=False, infinite=False, bounds=bounds)
    return found


def _bounds(system: System, cell: SymbolicCell, budget: Budget) -> NumberBounds | None:
    """Return proved bounds of a cell; None if there are none, or the cell may become infinite or NaN."""
    written = system.written[cell.name]
    cone = unrolling.cone(system, [cell.old, finite(written), system.now, system.begun, system.last])
    low = {**_grown(cell, system, above=False), **_tried(cell, above=False)}
    high = {**_grown(cell, system, above=True), **_tried(cell, above=True)}
    stays_finite = ContractFormula(name=cell.name, holds=finite(written))
    guesses = [*low.values(), *high.values(), *candidates(cone, ())][:_MAX_GUESSES]
    found: Invariants = invariants(cone, guesses, [stays_finite], (), budget)
    if not found.claims:
        return None
    kept = {c.formula.get_id() for c in found.conditions}
    lows = [value for value, guess in low.items() if guess.formula.get_id() in kept]
    highs = [value for value, guess in high.items() if guess.formula.get_id() in kept]
    return NumberBounds(max(lows), min(highs), whole=True) if lows and highs else None


def _tried(cell: SymbolicCell, *, above: bool) -> Mapping[Fraction, Candidate]:
    """Return guesses of a bound that the initial value keeps, by the bound."""
    initial, old = numeral(cell.initial), cell.old
    found = {}
    for value in _constants(cell):
        if (value >= initial) if above else (value <= initial):
            bound = z3.IntVal(int(value))
            text = f"{cell.name} {'<=' if above else '>='} {value}"
            found[value] = Candidate(text, old <= bound if above else old >= bound)
    return found


def _grown(cell: SymbolicCell, system: System, *, above: bool) -> Mapping[Fraction, Candidate]:
    """Return guesses that a cell moves by at most a constant a frame, by the bound in the longest run.

    Only frames that come no sooner than a robot says are few enough.
    """
    shortest_ns, longest_ns = gaps_ns(system.program.robot)
    if longest_ns is None:
        return {}
    initial, sign, found = numeral(cell.initial), 1 if above else -1, {}
    for step in sorted({abs(value) for value in _whole_constants(cell)} - {0})[:_MAX_STEPS]:
        bound = initial + sign * (step + step * (MAX_TIME_NS // shortest_ns + 1))
        if abs(bound) <= EXACT_WHOLE / 2:
            moved = sign * (cell.old - z3.IntVal(int(initial))) - z3.IntVal(int(step))
            grown = moved * z3.IntVal(shortest_ns) <= z3.IntVal(int(step)) * system.last
            found[bound] = Candidate(f"{cell.name} moves by at most {step} a frame", grown)
    return found


def _constants(cell: SymbolicCell) -> Iterator[Fraction]:
    """Yield whole numbers that may bound a cell: those in its formula, and their neighbors."""
    for value in _whole_constants(cell)[:_MAX_BOUNDS]:
        yield from (value - 1, value, value + 1)


def _whole_constants(cell: SymbolicCell) -> list[Fraction]:
    values: Sequence[Fraction] = numerals([cell.next, cell.initial])
    return [v for v in values if v.denominator == 1 and abs(v) <= EXACT_WHOLE / 2]
