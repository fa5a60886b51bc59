"""The walks over a whole program: every expression once, and the network node by node."""

from __future__ import annotations

from colony.ir.expression import Constant, MemoryCall, SensorValue, subexpressions
from colony.ir.program import Module
from colony.ir.walk import all_subexpressions, expressions, expressions_of, wiring_graph
from tests.programs import MS, program

OF = program(
    "let far = x > 3\n"
    "state s = false\nnext s = a\n"
    "machine go { start one one -> two when far }\n"
    "module m1 { let b = recently(a, 1 s) state y = 0 next y = x when b do out(v = x + 1) }\n"
    "module m2 { when true do out(v = 2) }\n"
    "network { w = m1 suppresses[2 s] (m2 inhibits m1 inhibits[1 s] m2)\n out = m2 suppresses w }\n"
    "limit out.v <= 7 when far\n"
    "contract c: x < 5"
)


def test_every_expression_is_met_once() -> None:
    found = [e.span.text for e in expressions(OF)]
    assert found == [
        "x > 3",
        "a",
        "far",
        "recently(a, 1 s)",
        "b",
        "x + 1",
        "x",
        "true",
        "2",
        "7",
        "far",
        "x < 5",
    ]
    (first, _) = (m for m in OF.modules if isinstance(m, Module))
    assert [e.span.text for e in expressions_of(first)] == ["recently(a, 1 s)", "b", "x + 1", "x"]


def test_an_expression_comes_before_its_parts_in_the_order_written() -> None:
    (far, *_) = expressions(OF)
    whole, left, right = subexpressions(far)
    assert whole is far
    assert isinstance(left, SensorValue)
    assert isinstance(right, Constant)
    assert [n.duration_ns for n in all_subexpressions(OF) if isinstance(n, MemoryCall)] == [1000 * MS]


def test_each_joint_stands_behind_what_it_joins() -> None:
    wired = wiring_graph(OF)
    inner, outer, most, root = wired.nodes
    assert [(j.dominant, j.inferior) for j in wired.nodes] == [
        ("m1", "m2"),
        ("m2", inner.name),
        ("m1", outer.name),
        ("m2", most.name),
    ]
    assert [j.path for j in wired.nodes] == [("w", 1, 1), ("w", 1, 0), ("w", 0), ("out", 0)]
    assert [j.window_ns for j in wired.nodes] == [1000 * MS, 0, 2000 * MS, 0]
    assert [j.relation for j in wired.nodes] == ["inhibits", "inhibits", "suppresses", "suppresses"]
    assert (wired.wires, wired.roots) == ({"w": most.name}, {"out": root.name})
    assert most.wire("n", "m1", "m2").wiring.windows_ns == (2000 * MS,)  # type: ignore[union-attr]
