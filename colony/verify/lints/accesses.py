"""Computed indices of a program, and the claims that they are inside their arrays.

A claim is about every frame in which the owner of the index (a module, a derived value, a transition, ...)
has all that it reads. Evaluation is strict, so no `if`, `and` or condition of a reduction around an access
matters. The claim becomes a let of the owner, with memory of its own that advances as the owner's does.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

from colony.ir import expression as ir
from colony.ir.expression import Expression
from colony.ir.program import Contract, Derived, Let, Machine, Module, Program, State
from colony.ir.types import BOOL, DIMENSIONLESS, Array
from colony.ir.walk import all_subexpressions, expressions_of
from colony.verify.claims import FALSE, TRUE, all_of, any_of, binary, constant, value_or
from colony.verify.difference.rewriting import rewrite_expression
from colony.verify.lints.bounds import is_finite
from colony.verify.reference.expressions import FrameValues, evaluate

Place = ir.Element | ir.Window

_READING = (
    ir.SensorValue,
    ir.DerivedValue,
    ir.LocalValue,
    ir.StateValue,
    ir.Now,
    ir.Restarted,
    ir.Fresh,
    ir.SentField,
    ir.IsActive,
    ir.IsCommanded,
    ir.IsIdle,
    ir.WonBy,
    ir.MemoryCall,
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Access:
    """A computed index of a program.

    Attributes:
        place: the element or window.
        decides: True in a predicate, a limit or a transition.
        owner: the module that has it, if any.
        claim: the claim that it is inside, about the instrumented program.
    """

    place: Place
    decides: bool
    owner: Module | None
    claim: Contract

    @property
    def size(self) -> int:
        """Return the size of the array."""
        return _size(self.place)

    @property
    def angle(self) -> Expression | None:
        """Return the angle of an element that is found by its bearing, else None."""
        match self.place:
            case ir.Element(index=ir.Nearest(angle=angle)):
                return angle
            case _:
                return None

    @property
    def index(self) -> Expression:
        """Return what is computed: an angle, an index, or the center of a window."""
        place = self.place
        return self.angle or (place.index if isinstance(place, ir.Element) else place.center)

    @property
    def is_shown(self) -> bool:
        """Return True if the index can be evaluated after a run: it is in no reduction, and has no memory."""
        hidden = (ir.LoopIndex, ir.LoopElement, ir.MemoryCall)
        return not any(isinstance(e, hidden) for e in ir.subexpressions(self.index))


def accesses(program: Program) -> tuple[Program, tuple[Access, ...]]:
    """Return the computed indices that need a proof, and the program instrumented for their claims."""
    collector = _Collector(program)
    derived = tuple(x for item in program.derived for x in collector.around(item))
    modules = tuple(collector.instrumented(m) if isinstance(m, Module) else m for m in program.modules)
    for limit in program.limits:
        roots = (limit.bound,) if limit.condition is None else (limit.bound, limit.condition)
        for root in roots:
            derived += collector.lets_of(root, decides=True)
    for contract in program.contracts:
        collector.claims_of_contract(contract)
    instrumented = replace(
        program,
        derived=derived,
        modules=modules,
        contracts=tuple(access.claim for access in collector.found),
        tests=(),
    )
    return instrumented, tuple(collector.found)


class _Collector:
    """Collects the computed indices of a program. Mutable: `found` grows."""

    def __init__(self, program: Program) -> None:
        calls = (e for e in all_subexpressions(program) if isinstance(e, ir.MemoryCall))
        self._cells = 1 + max((call.cell for call in calls), default=0)
        self.found: list[Access] = []

    def around(self, item: Derived) -> Iterator[Derived]:
        """Yield a derived value, and before it the lets for what it computes."""
        match item:
            case Let(expression=expression):
                yield from self.lets_of(expression)
            case State(next=update) if update is not None:
                yield from self.lets_of(update)
            case Machine(transitions=transitions):
                for transition in transitions:
                    yield from self.lets_of(transition.condition, decides=True)
            case _:
                pass
        yield item

    def lets_of(self, root: Expression, *, decides: bool = False) -> tuple[Let, ...]:
        """Return the lets for the claims about a file-level expression."""
        lets = []
        for place, claim in self._claims(root):
            let = Let(name=f"index {len(self.found)}", expression=_missing_with(claim, root))
            self._add(place, ir.DerivedValue(type=BOOL, name=let.name), decides=decides)
            lets.append(let)
        return tuple(lets)

    def instrumented(self, module: Module) -> Module:
        """Return a module with lets for the claims about its expressions."""
        lets = list(module.lets)
        for root in expressions_of(module):
            for place, claim in self._claims(root):
                let = Let(name=f"{module.name}. index {len(self.found)}", expression=claim)
                value = ir.LocalValue(type=BOOL, name=let.name)
                self._add(place, value, decides=root is module.when, owner=module)
                lets.append(let)
        return replace(module, lets=tuple(lets))

    def claims_of_contract(self, contract: Contract) -> None:
        """Collect the claims about a contract, which are contracts as they are."""
        for place, claim in self._claims(contract.expression):
            self._add(place, _missing_with(claim, contract.expression))

    def _claims(self, root: Expression) -> Iterator[tuple[Place, Expression]]:
        """Yield the places that need a proof, each with its claim, which has memory of its own."""
        for place, claim in _claims(root):
            if not _holds_always(claim):
                yield place, rewrite_expression(claim, str, self._cells * (len(self.found) + 1))

    def _add(
        self, place: Place, claim: Expression, *, decides: bool = False, owner: Module | None = None
    ) -> None:
        name, span = f"index {len(self.found)}", place.span
        contract = Contract(name=name, expression=value_or(claim, TRUE), span=span)
        self.found.append(Access(place=place, decides=decides, owner=owner, claim=contract))


# --- claims ----------------------------------------------------------------------------------------


def _claims(e: Expression) -> Iterator[tuple[Place, Expression]]:
    """Yield the computed indices of an expression, and the conditions that they are inside."""
    match e:
        case ir.ValueOr(expression=first, other=other):
            parts: Sequence[Expression] = (first,)
            if isinstance(first, ir.Element):  # `other` stands for an element that is outside
                parts = ir.children(first)
            for place, claim in _claims_of(parts):
                yield place, value_or(_missing_with(claim, first), TRUE)
            yield from _claims(other)
        case ir.Reduce(body=body, condition=condition, arrays=arrays):
            yield from _claims_of(array for _, array in arrays)
            for place, claim in _claims_of((body,) if condition is None else (body, condition)):
                yield place, replace(e, type=BOOL, function=ir.Function.ALL, body=claim, condition=None)
        case _:
            if isinstance(e, ir.Element | ir.Window):
                yield e, _is_inside(e)
            yield from _claims_of(ir.children(e))


def _claims_of(expressions: Iterable[Expression]) -> Iterator[tuple[Place, Expression]]:
    for e in expressions:
        yield from _claims(e)


def _is_inside(place: Place) -> Expression:
    """Return the condition that an index, or all that a window takes, is inside."""
    index = place.index if isinstance(place, ir.Element) else place.center
    if place.wraps and not isinstance(index, ir.Nearest):
        return is_finite(index)
    reach = place.reach if isinstance(place, ir.Window) else 0
    whole = ir.Call(type=DIMENSIONLESS, function=ir.Function.ROUND, arguments=(index,))
    low, high = (constant(float(x), DIMENSIONLESS) for x in (reach, _size(place) - 1 - reach))
    return ir.Within(type=BOOL, operand=whole, low=low, high=high)


def _size(place: Place) -> int:
    assert isinstance(place.array.type, Array)
    return place.array.type.size


def _holds_always(claim: Expression) -> bool:
    """Return True if a claim that reads nothing is true."""
    if any(isinstance(e, _READING) for e in ir.subexpressions(claim)):
        return False
    return evaluate(claim, FrameValues(number=1, t_ns=0, first_ns=0, states={}), {}, ()) is True


def _missing_with(claim: Expression, e: Expression) -> Expression:
    """Return a claim that is missing wherever `e` is, and else has its value."""
    read = [_is_itself(x) for x in _needs(e)]
    return any_of((claim, all_of((FALSE, *read)))) if read else claim


def _needs(e: Expression) -> Iterator[Expression]:
    """Yield what an expression reads that can be missing, each once."""
    match e:
        case ir.ValueOr(other=other):
            yield from _needs(other)
        case ir.SensorValue() | ir.DerivedValue() | ir.LocalValue() | ir.SentField():
            yield e
        case _:
            yield from {x: None for child in ir.children(e) for x in _needs(child)}


def _is_itself(e: Expression) -> Expression:
    if not isinstance(e.type, Array):
        return binary(ir.Binary.EQUAL, e, e)
    equal = ir.BinaryOperation(type=replace(e.type, element=BOOL), operator=ir.Binary.EQUAL, left=e, right=e)
    return ir.Call(type=BOOL, function=ir.Function.ALL, arguments=(equal,))
