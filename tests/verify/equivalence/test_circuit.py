from __future__ import annotations

from itertools import product
from random import Random

import pytest

from colony.verify.equivalence.circuit import FALSE, TRUE, Activity, Circuit, Input
from tests.verify.equivalence.valuations import valued

NAMES = ("a", "b", "c", "d")


def every_valuation() -> list[dict[Input, bool]]:
    return [
        {Activity(name): value for name, value in zip(NAMES, values, strict=True)}
        for values in product((False, True), repeat=len(NAMES))
    ]


@pytest.mark.parametrize("seed", range(40))
def test_formulas_mean_what_they_say(seed: int) -> None:
    """Random formulas, with all rules applied to them, against the same computed on truth tables."""
    random, circuit = Random(seed), Circuit()
    valuations = every_valuation()
    pool = [(FALSE, [False] * 16), (TRUE, [True] * 16)]
    pool += [(circuit.input(of), [v[of] for v in valuations]) for of in map(Activity, NAMES)]
    for _ in range(60):
        (a, x), (b, y), (c, z) = (random.choice(pool[-12:] + pool[:6]) for _ in range(3))
        made = random.choice(
            [
                (circuit.both(a, b), [p and q for p, q in zip(x, y, strict=True)]),
                (circuit.either(a, b ^ 1), [p or not q for p, q in zip(x, y, strict=True)]),
                (circuit.all([a, b, c ^ 1]), [p and q and not r for p, q, r in zip(x, y, z, strict=True)]),
                (circuit.any([a, b, c]), [p or q or r for p, q, r in zip(x, y, z, strict=True)]),
                (circuit.same(a, b), [p == q for p, q in zip(x, y, strict=True)]),
                (circuit.choice(a, b, c), [q if p else r for p, q, r in zip(x, y, z, strict=True)]),
            ]
        )
        pool.append(made)
    found = [valued(circuit, valuation) for valuation in valuations]
    for literal, expected in pool:
        assert [value(literal) for value in found] == expected, seed


def test_equal_formulas_are_one_literal() -> None:
    circuit = Circuit()
    a, b, c = (circuit.input(Activity(name)) for name in "abc")
    assert circuit.both(a, b) == circuit.both(b, a)
    assert circuit.either(a, circuit.both(a ^ 1, b)) == circuit.either(a, b)
    assert circuit.both(a, circuit.both(a ^ 1, b)) == FALSE
    assert circuit.both(a, circuit.either(a, b)) == a
    joined = circuit.both(circuit.both(a, c), b)
    assert circuit.all([a, b, c]) == joined, "in the association that is there"
    assert circuit.input(Activity("a")) == a
