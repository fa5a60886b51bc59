"""The terms of a system as a graph of ids, which is much faster to walk than z3's terms."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple, Protocol

import z3
from z3 import z3core


class _Cell(Protocol):
    @property
    def old(self) -> z3.ExprRef: ...
    @property
    def next(self) -> z3.ExprRef: ...


class _Fact(Protocol):
    @property
    def formula(self) -> z3.BoolRef: ...


class Reach(NamedTuple):
    """The ids of some terms and of all their subterms, and those of the constants and cells among them."""

    visited: frozenset[int]
    leaves: frozenset[int]


class Graph:
    """The structure of terms, recorded when they are first added. Mutable. Keeps terms alive."""

    def __init__(self, cells: Iterable[_Cell]) -> None:
        self._cells = {cell.old.get_id(): cell for cell in cells}
        self._behind: dict[int, tuple[Sequence[_Fact], Reach]] = {}
        self._operands: dict[int, tuple[int, ...]] = {}
        self._constants: dict[int, tuple[str, z3.ExprRef]] = {}
        self._kept: list[z3.ExprRef] = []

    def add(self, terms: Iterable[z3.ExprRef]) -> list[int]:
        """Add terms with all their subterms; return the ids of the terms."""
        roots = list(terms)
        self._kept += roots
        context = z3.main_ctx().ref()
        pending = [term.as_ast() for term in roots]
        while pending:  # of z3's own pointers, as wrapping them all takes several times as long
            term = pending.pop()
            key = z3core.Z3_get_ast_id(context, term)
            if key in self._operands:
                continue
            count = z3core.Z3_get_app_num_args(context, term)
            operands = [z3core.Z3_get_app_arg(context, term, i) for i in range(count)]
            self._operands[key] = tuple(z3core.Z3_get_ast_id(context, x) for x in operands)
            pending += operands
            if not operands:
                self._add_constant(key, z3.ExprRef(term))
        return [term.get_id() for term in roots]

    def _add_constant(self, key: int, leaf: z3.ExprRef) -> None:
        declaration = leaf.decl()
        if declaration.kind() == z3.Z3_OP_UNINTERPRETED:
            name = str(declaration.name())
            self._constants[key] = (name, z3.Const(name, leaf.sort()))

    def operands(self, key: int) -> tuple[int, ...]:
        """Return the ids of the operands of the term with this id."""
        return self._operands[key]

    def constant(self, key: int) -> tuple[str, z3.ExprRef]:
        """Return the name and the term of an uninterpreted constant by its id."""
        return self._constants[key]

    def reach(self, keys: Iterable[int]) -> Reach:
        """Return what is in the terms with these ids."""
        visited, leaves, pending = set[int](), set[int](), list(keys)
        while pending:
            key = pending.pop()
            if key in visited:
                continue
            visited.add(key)
            pending.extend(self._operands[key])
            if key in self._constants:
                leaves.add(key)
        return Reach(frozenset(visited), frozenset(leaves))

    def behind(self, leaf: int, facts: Sequence[_Fact]) -> Reach:
        """Return what is in the facts about a constant, and if it is a cell, in its value after the frame."""
        known = self._behind.get(leaf)
        if known is not None and known[0] is facts:
            return known[1]
        formulas = [fact.formula for fact in facts]
        cell = self._cells.get(leaf)
        found = self.reach(self.add(formulas if cell is None else [cell.next, *formulas]))
        self._behind[leaf] = (facts, found)
        return found
