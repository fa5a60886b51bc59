"""Transition systems built by hand: small enough to know all about them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import z3

from colony.ir.program import Program, Robot
from colony.verify.symbolic.system import ContractFormula, Fact, FactKind, Graph, SymbolicCell, System

NOW, LAST, BEGUN = z3.Int("now"), z3.Int("last"), z3.Bool("begun")
TRUE = z3.BoolVal(True)


def system(
    cells: Sequence[SymbolicCell],
    claims: dict[str, z3.BoolRef],
    definitions: Sequence[tuple[z3.ExprRef, z3.BoolRef]] = (),
) -> System:
    """A system with a clock, these cells and contracts; `definitions` are constants with their facts."""
    clock = z3.And(z3.Implies(BEGUN, NOW > LAST), z3.Implies(z3.Not(BEGUN), NOW == 0))
    facts = [Fact(FactKind.ASSUMPTION, NOW, clock)]
    facts += [Fact(FactKind.DEFINITION, subject, formula) for subject, formula in definitions]
    by_id: dict[int, tuple[Fact, ...]] = {}
    for fact in (replace(fact, position=i) for i, fact in enumerate(facts)):
        by_id[fact.subject.get_id()] = (*by_id.get(fact.subject.get_id(), ()), fact)
    all_cells = (
        SymbolicCell(name="begun", old=BEGUN, next=TRUE, initial=z3.BoolVal(False)),
        SymbolicCell(name="last", old=LAST, next=NOW, initial=z3.IntVal(0)),
        *cells,
    )
    return System(
        program=Program(robot=Robot(name="r")),
        now=NOW,
        begun=BEGUN,
        last=LAST,
        restarted=z3.Bool("restarted"),
        sensors={},
        python={},
        cells=all_cells,
        assumptions=(clock,),
        definitions=tuple(formula for _, formula in definitions),
        invariants=(),
        auxiliaries=(),
        facts=by_id,
        inexact={},
        graph=Graph(all_cells),
        derived={},
        states={},
        locals={},
        modules={},
        active={},
        actuators={},
        claims=tuple(ContractFormula(name=name, holds=holds) for name, holds in claims.items()),
    )


def counter(limit: int | None = None) -> SymbolicCell:
    """`count` goes up by one each frame in which the input `tick` is true; at `limit` it begins anew."""
    count, tick = z3.Int("count"), z3.Bool("tick")
    following = z3.If(tick, count + 1, count)
    if limit is not None:
        following = z3.If(following == limit, 0, following)
    return SymbolicCell(name="count", old=count, next=following, initial=z3.IntVal(0))


def delay(*names: str) -> list[SymbolicCell]:
    """A flag for each name: the first is what the input `tick` was, each other what the one before it was."""
    flags = [z3.Bool(name) for name in names]
    befores = [z3.Bool("tick"), *flags]
    return [
        SymbolicCell(name=name, old=flag, next=before, initial=z3.BoolVal(False))
        for name, flag, before in zip(names, flags, befores, strict=False)
    ]
