"""Certificates: proofs as SMT-LIB 2.6, which z3 and cvc5 check without colony.

A certificate has one or two *parts*: the contract while every client is in time, and if the verdict covers it
the contract under a disturbance. A part defines the formulas of a few consecutive frames of the contract's
cone of influence, and has these queries, whose answers must all be `unsat`:

- each invariant holds before the first frame, and before the next frame after any frame;
- each contract that the proof uses, and the one that is proved, holds in any frame; by k-induction, in each
  of the first k frames, and in the frame after any k frames in which it holds.

The queries about an invariant assume invariants and contracts of the frame, those about a contract assume
invariants and the contracts that were proved before it. So all of them hold, by induction over frames, and in
each frame over the contracts in the order of their proofs. A query names what it assumes: an unsatisfiable
core of what the prover knew when it had proved the contract.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Sequence
from typing import NamedTuple

import z3

from colony.ir.program import Let
from colony.ir.version import SEMANTICS
from colony.text.wording import one_line
from colony.verify.contracts.attempt import ProofContext, formula_text
from colony.verify.contracts.prove import ContractProver
from colony.verify.contracts.results import ProofOptions, Proved, ProvedInTime
from colony.verify.contracts.solver import Budget, IncrementalSolver, SolverAnswer
from colony.verify.symbolic.encode import claim_name
from colony.verify.symbolic.system import Disturbance
from colony.verify.symbolic.unrolling import Unrolling

_SHARE = 2.0
"""Resources of each query, in multiples of those of the prover's queries."""

_COVERED = {
    None: "runs with every client in time",
    Disturbance.LATE: "runs with clients late or lost",
    Disturbance.OPERATORS: "runs with clients late or lost, and commands from outside the network",
}


def certificate(prover: ContractProver, proved: Proved | ProvedInTime, options: ProofOptions) -> str | None:
    """Return the certificate of a contract that `prover` has just proved.

    None if z3 gave up on a query within the limits of `options`.
    """
    parts: list[_Part] = []
    assumed: list[Let] = []
    for context, disturbance in prover.proof_contexts(proved):
        part = _Part(context, proved.contract.name, disturbance, options)
        if not part.find_queries():
            return None
        parts.append(part)
        derived = context.system.program.derived
        assumed = [d for d in derived if isinstance(d, Let) and d.name in proved.contract.assuming]
    return "".join(
        f"{line}\n" for line in (*_header(proved, parts, assumed), *(x for p in parts for x in p.lines()))
    )


class _Item(NamedTuple):
    """An invariant before a frame, or a contract in it: the name in the certificate, a text, the formula."""

    name: str
    text: str
    formula: z3.BoolRef
    is_contract: bool

    def at(self, i: int) -> str:
        """Return the name of the definition of the item in frame `i`."""
        return f"{self.name} {'in' if self.is_contract else 'before'} frame {i}"


class _Query(NamedTuple):
    """A query: the definition `goal`, of `item`, follows from those in `assumed`, of `uses` and frames."""

    comment: str
    item: _Item
    goal: str
    assumed: Sequence[str]
    uses: Sequence[_Item]


class _Part:
    """The proof of a contract in the context in which it was proved. Mutable: finds its queries.

    `assumed` are the items that are used and not proved: the contract, which the part before proves; other
    contracts whose proof is in another encoding; ranges of memory by abstract interpretation.
    """

    def __init__(
        self, context: ProofContext, contract: str, disturbance: Disturbance | None, options: ProofOptions
    ) -> None:
        self.disturbance = disturbance
        self.assumed: list[_Item] = []
        self._options = options
        self._given = "" if disturbance is None else contract
        self._claim = contract if disturbance is None else claim_name(contract, disturbance)
        self._cone = context.cones[self._claim]
        self._frames = Unrolling(self._cone.system, self._cone)
        lemmas = context.lemmas(self._cone)
        self._contracts = [_Item(f"contract {c.name}", c.name, c.holds, is_contract=True) for c in lemmas]
        ranges = {f.get_id(): (formula_text(f), f) for f in self._cone.invariants}
        guesses = context.known_invariants(self._cone)
        found = {**{g.formula.get_id(): (g.text, g.formula) for g in guesses}, **ranges}
        self._invariants = [
            _Item(f"invariant {i}", text, formula, is_contract=False)
            for i, (text, formula) in enumerate(found.values(), 1)
        ]
        self._ranges = ranges.keys()
        self._definitions: dict[str, Sequence[z3.BoolRef]] = {}
        self._queries: list[_Query] = []

    # --- queries ---------------------------------------------------------------------------------

    def find_queries(self) -> bool:
        """Return True if z3 proves the contract, and the invariants that are needed for that."""
        done: set[str] = set()
        pending = [next(item for item in self._contracts if item.text == self._claim)]
        while pending:
            item = pending.pop()
            if item.name in done:
                continue
            done.add(item.name)
            queries = [] if item.text == self._given else self._proof(item)
            if not queries:
                if item.text == self._claim or not (
                    item.is_contract or item.formula.get_id() in self._ranges
                ):
                    return False
                self.assumed.append(item)
            self._queries += queries
            pending += [used for query in queries for used in query.uses]
        order = {item.name: i for i, item in enumerate((*self._invariants, *self._contracts))}
        self._queries.sort(key=lambda query: order[query.item.name])
        return True

    def _proof(self, item: _Item) -> list[_Query]:
        """Return the queries that prove an item; none if z3 gave up on one."""
        queries = self._induction(item) if item.is_contract else self._preservation(item)
        found = [query for query in queries if query is not None]
        return found if len(found) == len(queries) else []

    def _preservation(self, item: _Item) -> list[_Query | None]:
        """Return the queries that an invariant holds before the first frame, and before the next one."""
        items = [(x, 0) for x in (*self._invariants, *self._contracts)]
        start, frame = [self._initial()], [self._facts(0), self._transition(0)]
        return [
            self._query("before the first frame", (item, 0), start, []),
            self._query("before the next frame", (item, 1), frame, items),
        ]

    def _induction(self, item: _Item) -> list[_Query | None]:
        """Return the queries that a contract holds in every frame, by induction as short as possible."""
        for k in range(self._options.depth + 1):
            step = self._holds("in any frame" if k == 0 else f"after {k} frames", item, k, [])
            if step is not None:
                start = [self._initial()]
                return [*(self._holds(f"in frame {i} of a run", item, i, start) for i in range(k)), step]
        return [None]

    def _holds(self, where: str, item: _Item, last: int, start: list[str]) -> _Query | None:
        """Return the query that a contract holds in the last of some frames if it holds in those before."""
        hard = [*start, *map(self._facts, range(last + 1)), *map(self._transition, range(last))]
        ahead = self._contracts[: self._contracts.index(item)]
        items = [(x, i) for i in range(last + 1) for x in (*self._invariants, *ahead)]
        return self._query(where, (item, last), hard, [*items, *((item, i) for i in range(last))])

    def _query(
        self, where: str, goal: tuple[_Item, int], hard: list[str], usable: list[tuple[_Item, int]]
    ) -> _Query | None:
        """Return the query that `hard` and some of `usable` imply `goal`; None if z3 does not prove it."""
        solver = IncrementalSolver(Budget(self._options), _SHARE)
        for name in hard:
            solver.add(*self._definitions[name])
        items = {self._at(*x): x[0] for x in usable}
        for name in items:
            solver.add(z3.Implies(z3.Bool(name), z3.And(*self._definitions[name])))
        name = self._at(*goal)
        solver.add(z3.Not(z3.And(*self._definitions[name])))
        if solver.check([z3.Bool(x) for x in items]) is not SolverAnswer.UNSAT:
            return None
        core = [x for x in items if x in solver.core()]
        return _Query(where, goal[0], name, (*hard, *core), [items[x] for x in core])

    # --- definitions -----------------------------------------------------------------------------

    def _initial(self) -> str:
        return self._define("initial memory", self._frames.initial())

    def _facts(self, i: int) -> str:
        return self._define(_facts_of(i), self._frames.frame(i))

    def _transition(self, i: int) -> str:
        return self._define(_transition_from(i), self._frames.transition(i))

    def _at(self, item: _Item, i: int) -> str:
        return self._define(item.at(i), [self._frames.at(i, item.formula)])

    def _define(self, name: str, formulas: Sequence[z3.BoolRef]) -> str:
        self._definitions.setdefault(name, formulas)
        return name

    # --- text ------------------------------------------------------------------------------------

    def lines(self) -> Iterator[str]:
        """Yield the text of the part."""
        used = {name for query in self._queries for name in (*query.assumed, query.goal)}
        yield f"\n; --- {_COVERED[self.disturbance]}"
        yield "(push 1)"
        for constant in self._constants(used):
            yield f"(declare-const |{constant.decl().name()}| {constant.sort().sexpr()})"
        for name, formulas in self._definitions.items():
            if name in used:
                yield f"(define-fun |{name}| () Bool {_conjunction(formulas)})"
        for query in self._queries:
            yield f"\n; {_text(query.item)}: {query.comment}"
            yield "(push 1)"
            yield from (f"(assert |{name}|)" for name in query.assumed)
            yield f"(assert (not |{query.goal}|))"
            yield "(set-info :status unsat)"
            yield "(check-sat)"
            yield "(pop 1)"
        yield "(pop 1)"

    def _constants(self, used: Collection[str]) -> Iterator[z3.ExprRef]:
        """Yield the constants of the frames that definitions in `used` are about."""
        i = 0
        while i == 0 or _facts_of(i) in used or _transition_from(i - 1) in used:
            yield from (self._frames.at(i, cell.old) for cell in self._cone.cells)
            if _facts_of(i) in used:
                yield from (self._frames.at(i, constant) for constant in self._cone.constants)
            i += 1


def _facts_of(i: int) -> str:
    return f"facts of frame {i}"


def _transition_from(i: int) -> str:
    return f"frame {i} leads to frame {i + 1}"


def _conjunction(formulas: Sequence[z3.BoolRef]) -> str:
    """Return a conjunction with a line for each formula."""
    return "\n  ".join(["(and true", *(re.sub(r"\s+", " ", x.sexpr()) for x in formulas)]) + ")"


def _text(item: _Item) -> str:
    return item.name if item.is_contract else f"{item.name}, {one_line(item.text)}"


def _header(proved: Proved | ProvedInTime, parts: Sequence[_Part], assumed: Sequence[Let]) -> Iterator[str]:
    """Yield what a certificate states, and what it leaves to be believed."""
    contract = proved.contract
    yield f"; Certificate (colony, semantics {SEMANTICS}): the contract holds in each frame of these runs."
    yield f";   contract {contract.name}: {one_line(contract.expression.span.text)}"
    yield from (f";   assuming {a.name}: {one_line(a.expression.span.text)}" for a in assumed)
    yield "; The answer to every query must be `unsat`: z3 FILE, or cvc5 --incremental FILE."
    yield "; To be believed: the formulas are those of the program, and so are ranges of numbers that decided"
    yield "; parts of them; what they leave out changes nothing."
    yield "; NAME@I is memory before frame I, an input or a result in it; rounded#N is any rounded result."
    for part in parts:
        yield f"; Covered: {_COVERED[part.disturbance]}."
        yield from (f"; Assumed: {_text(item)}, {_proof_of(item, contract.name)}." for item in part.assumed)
    if isinstance(proved, Proved) and not contract.in_time and len(parts) == 1:
        others = Disturbance.OPERATORS if proved.operators else Disturbance.LATE
        yield f"; Covered: {_COVERED[others]}, in which the contract has the same formula."
    yield "(set-info :smt-lib-version 2.6)"
    yield "(set-logic ALL)"


def _proof_of(item: _Item, contract: str) -> str:
    """Return where the proof of an item is that a part uses without a proof."""
    if not item.is_contract:
        return "which is a part of the encoding"
    name = item.text.split()[0]
    return "which is proved first" if name == contract else f"which {name}.smt2 proves"
