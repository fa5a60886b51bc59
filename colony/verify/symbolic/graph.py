"""The terms of a system as a graph of ids, which is much faster to walk than z3's terms."""

from __future__ import annotations

from collections.abc import Iterable

import z3


class Graph:
    """The structure of terms, recorded when they are first added. Mutable. Keeps terms alive."""

    def __init__(self) -> None:
        self._operands: dict[int, tuple[int, ...]] = {}
        self._constants: dict[int, tuple[str, z3.ExprRef]] = {}
        self._kept: list[z3.ExprRef] = []

    def add(self, terms: Iterable[z3.ExprRef]) -> list[int]:
        """Add terms with all their subterms; return the ids of the terms."""
        roots = list(terms)
        pending = list(roots)
        while pending:
            term = pending.pop()
            key = term.get_id()
            if key in self._operands:
                continue
            self._kept.append(term)
            operands = term.children()
            self._operands[key] = tuple(x.get_id() for x in operands)
            pending.extend(operands)
            if not operands and term.decl().kind() == z3.Z3_OP_UNINTERPRETED:
                self._constants[key] = (str(term.decl().name()), term)
        return [term.get_id() for term in roots]

    def operands(self, key: int) -> tuple[int, ...]:
        """Return the ids of the operands of the term with this id."""
        return self._operands[key]

    def constant(self, key: int) -> tuple[str, z3.ExprRef] | None:
        """Return the name and the term with this id, if it is an uninterpreted constant."""
        return self._constants.get(key)
