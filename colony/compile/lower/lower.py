"""Lowering: from the typed program and its clients to the compiled program, with all of its code.

Everything is lowered on first use, beginning with the decisions, so that the code of one client contains only
what that client needs. Nothing recurses over chains of lets, wires or guards.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import assert_never

from colony.compile.guards import Client, ClientList
from colony.compile.lower.builder import CodeBuilder
from colony.compile.lower.declarations import Declarations
from colony.compile.lower.expressions import ExpressionLowering, LoweringScope, NameResolver, kind_of
from colony.compile.lower.memory import GuardLowering
from colony.execute.code import (
    ActuatorCode,
    ClientCode,
    Code,
    Commanded,
    ContractCode,
    Kind,
    LimitCode,
    Lost,
    PythonCall,
    PythonField,
    PythonRead,
    Sent,
)
from colony.execute.compiled import Compiled
from colony.execute.needs import trimmed
from colony.execute.operators import Operator
from colony.ir import expression as ir
from colony.ir import program as program_ir
from colony.ir.expression import Binary, Function, Unary
from colony.ir.memory import sent_cell
from colony.ir.types import Array
from colony.ir.walk import in_time

# --- contracts ----------------------------------------------------------------------------------------
#
# Lowering of contracts in Kleene's three-valued logic (see `colony.verify.reference.kleene`).
#
# Each scalar becomes two ops: its value, and the condition that it is known. Where it is not known, the value
# is a placeholder.


@dataclass(frozen=True, slots=True)
class KnownOp:
    """The op number of a scalar's value, and that of the condition that it is known."""

    value: int
    known: int


KnownValues = tuple[KnownOp, ...]
"""The elements of an expression's value; a single one for a scalar."""


@dataclass(frozen=True, slots=True)
class LoweredRound:
    """A round of a reduction: its variable and index, and the elements of its arrays by name."""

    variable: str
    k: int
    elements: Mapping[str, KnownOp]


Loops = tuple[LoweredRound, ...]
"""The present rounds of the enclosing reductions, outermost first."""


class ContractLowering:
    """Lowers contracts into the builder of `expressions`."""

    def __init__(self, expressions: ExpressionLowering, names: NameResolver) -> None:
        self.expressions = expressions
        self.builder: CodeBuilder = expressions.builder
        self.names = names

    def holds(self, e: ir.Expression, label: str) -> int:
        """Return the condition that a contract is known to be true; `label` is the prefix of its cells."""
        return self._is(e, True, label)

    def _is(self, e: ir.Expression, wanted: bool, label: str) -> int:
        """Return the condition that a condition is known to be `wanted`.

        That takes fewer ops than its value and whether it is known: `A implies B` is true if `A` is known to
        be false, or `B` to be true.
        """
        match e:
            case ir.UnaryOperation(operator=Unary.NOT, operand=operand):
                return self._is(operand, not wanted, label)
            case ir.BinaryOperation(operator=(Binary.AND | Binary.OR | Binary.IMPLIES) as operator):
                left = self._is(e.left, wanted is not (operator is Binary.IMPLIES), label)
                right = self._is(e.right, wanted, label)
                takes_both = wanted is (operator is Binary.AND)
                return self.builder.both(left, right) if takes_both else self.builder.either(left, right)
            case _:
                (result,) = self._lower(e, label, ())
                value = result.value if wanted else self.builder.negation(result.value)
                return self.builder.both(result.known, value)

    # --- expressions -----------------------------------------------------------------------------

    def _lower(self, e: ir.Expression, label: str, loops: Loops) -> KnownValues:
        def lower(operand: ir.Expression) -> KnownValues:
            return self._lower(operand, label, loops)

        match e:
            case ir.UnaryOperation(operator=operator, operand=operand):
                is_not = operator is Unary.NOT
                function = self.builder.negation if is_not else partial(self.builder.apply, Operator.NEGATE)
                return _each(partial(self._strict, function), lower(operand))
            case ir.BinaryOperation(operator=operator, left=left, right=right):
                return _each(partial(self._binary, operator), lower(left), lower(right))
            case ir.Conditional(condition=condition, yes=yes, no=no):
                return _each(self._choice, lower(condition), lower(yes), lower(no))
            case ir.Within(operand=operand, low=low, high=high):
                within = partial(self._strict, self.expressions.within)
                return _each(within, lower(operand), lower(low), lower(high))
            case ir.Nearest(bearings=bearings, angle=angle):
                return _each(partial(self._strict, partial(self.expressions.nearest, bearings)), lower(angle))
            case ir.Element() | ir.Slice() | ir.Window():
                return self._array_access(e, label, loops)
            case ir.ValueOr(expression=expression, other=other):
                return _each(self._value_or, lower(expression), lower(other))
            case ir.FunctionCall():
                return self._call(e, label, loops)
            case ir.Reduce():
                return (self._reduce(e, label, loops),)
            case ir.MemoryCall():
                return self._memory(e, [lower(a) for a in e.arguments], label, loops)
            case _:
                return self._leaf(e, label, loops)

    def _leaf(self, e: ir.Expression, label: str, loops: Loops) -> KnownValues:
        always = self.builder.literal(True)
        if isinstance(e, ir.SentField) and not self.names.has_idle_command(e.actuator):
            return (self._held(e),)
        if isinstance(e, ir.LoopElement):
            return ([turn.elements[e.name] for turn in loops if e.name in turn.elements][-1],)
        present = self.expressions.present((e,), None)
        scope = LoweringScope(owner=None, label=label, ready=always, loops=_indices_of(loops))
        return tuple(KnownOp(value, present) for value in self.expressions.lower(e, scope))

    def _held(self, e: ir.SentField) -> KnownOp:
        """Return the field of an actuator on `idle hold`: the last value sent, unknown before the first."""
        builder, actuator = self.builder, e.actuator
        commanded = builder.add(Commanded(actuator), Kind.BOOL)
        kind = self.names.field_kind(actuator, e.field_index)
        sent = builder.add(Sent(actuator, e.field_index), kind)
        name, place = f"{actuator} sent {e.field_index}", sent_cell(actuator, e.field_index)
        initial = False if kind is Kind.BOOL else 0.0
        last = builder.cell(f"{name} value", kind, initial, f"{place} value")
        ever = builder.cell(f"{name} known", Kind.BOOL, False, f"{place} known")
        builder.keep(last, commanded, sent)
        builder.keep(ever, commanded, builder.literal(True))
        value = builder.apply(Operator.SELECT, commanded, sent, last)
        return KnownOp(value, builder.either(commanded, ever))

    # --- operators -------------------------------------------------------------------------------

    def _strict(self, function: Callable[..., int], *x: KnownOp) -> KnownOp:
        """Apply a function to values, unknown if one of them is."""
        return KnownOp(function(*[v.value for v in x]), self._all_known(x))

    def _all_known(self, x: Sequence[KnownOp]) -> int:
        return self.builder.both(*[v.known for v in x])

    def _binary(self, operator: Binary, x: KnownOp, y: KnownOp) -> KnownOp:
        match operator:
            case Binary.AND:
                return self._all((x, y))
            case Binary.OR:
                return self._any((x, y))
            case Binary.IMPLIES:
                return self._any((self._strict(self.builder.negation, x), y))
            case _:
                return self._strict(partial(self.expressions.binary, operator), x, y)

    def _all(self, x: Sequence[KnownOp]) -> KnownOp:
        """Return the conjunction: known if all operands are, or if one is known to be false."""
        value = self.builder.both(*[v.value for v in x])
        return self._connected(value, x, [self.builder.negation(v.value) for v in x])

    def _any(self, x: Sequence[KnownOp]) -> KnownOp:
        """Return the disjunction: known if all operands are, or if one is known to be true."""
        value = self.builder.either(*[v.value for v in x])
        return self._connected(value, x, [v.value for v in x])

    def _connected(self, value: int, x: Sequence[KnownOp], settles: Sequence[int]) -> KnownOp:
        """Return a value that is known if all operands are, or if one is that settles it alone."""
        builder = self.builder
        certain = [s for v, s in zip(x, settles, strict=True) if self._is_known(v)]
        uncertain = [(v.known, s) for v, s in zip(x, settles, strict=True) if not self._is_known(v)]
        conditions = dict.fromkeys(known for known, _ in uncertain)
        all_known = builder.both(*conditions)
        if len(conditions) > 1:
            certain += [builder.both(known, s) for known, s in uncertain]
        return KnownOp(value, builder.either(all_known, *certain))

    def _is_known(self, x: KnownOp) -> bool:
        return self.builder.is_true(x.known)

    def _choice(self, condition: KnownOp, yes: KnownOp, no: KnownOp) -> KnownOp:
        return KnownOp(
            self.builder.apply(Operator.SELECT, condition.value, yes.value, no.value),
            self.builder.both(
                condition.known, self.builder.apply(Operator.SELECT, condition.value, yes.known, no.known)
            ),
        )

    def _value_or(self, x: KnownOp, other: KnownOp) -> KnownOp:
        return KnownOp(
            self.builder.apply(Operator.SELECT, x.known, x.value, other.value),
            self.builder.either(x.known, other.known),
        )

    # --- arrays ----------------------------------------------------------------------------------

    def _array_access(self, e: ir.Element | ir.Slice | ir.Window, label: str, loops: Loops) -> KnownValues:
        whole = self._lower(e.array, label, loops)
        match e:
            case ir.Slice(indices=indices):
                return tuple(whole[i] for i in indices)
            case ir.Element(index=index):
                (given,) = self._lower(index, label, loops)
                position = self.expressions.position(e, len(whole), given.value)
                return (self._pick(whole, KnownOp(position, given.known)),)
            case ir.Window(center=center):
                (middle,) = self._lower(center, label, loops)
                return tuple(self._pick(whole, i) for i in self._indices(e, len(whole), middle))

    def _indices(self, e: ir.Window, size: int, center: KnownOp) -> KnownValues:
        indices = self.expressions.window_indices(e, size, center.value)
        return tuple(KnownOp(i, center.known) for i in indices)

    def _pick(self, array: KnownValues, index: KnownOp) -> KnownOp:
        """Return an element, unknown at an index that is outside or not finite."""
        value = self.expressions.pick(tuple(x.value for x in array), index.value)
        known = array[0].known
        if not all(x.known == known for x in array):
            known = self.expressions.pick(tuple(x.known for x in array), index.value)
        is_inside = self.builder.apply(Operator.FINITE, index.value)
        return KnownOp(value, self.builder.both(index.known, is_inside, known))

    # --- functions -------------------------------------------------------------------------------

    def _call(self, e: ir.FunctionCall, label: str, loops: Loops) -> KnownValues:
        if e.function in ir.INDEX_FUNCTIONS:
            return (self._index_function(e.function, e.arguments[0], label, loops),)
        arguments = [self._lower(a, label, loops) for a in e.arguments]
        if e.function in ir.REDUCTIONS:
            return (self._reduction(e.function, [x for a in arguments for x in a]),)
        function = partial(self.expressions.function, e.function)
        return _each(partial(self._strict, function), *arguments)

    def _reduction(self, function: Function, x: Sequence[KnownOp]) -> KnownOp:
        match function:
            case Function.ANY:
                return self._any(x)
            case Function.ALL:
                return self._all(x)
            case _:
                value = self.expressions.reduction(function, tuple(v.value for v in x))
                return KnownOp(value, self._all_known(x))

    def _index_function(self, function: Function, e: ir.Expression, label: str, loops: Loops) -> KnownOp:
        """Return the index of the least or greatest element; for a slice or window, in the whole array."""
        index_of, builder = self.expressions.index_of, self.builder
        match e:
            case ir.Slice(indices=indices):
                chosen = self._lower(e, label, loops)
                places = tuple(builder.literal(float(i)) for i in indices)
            case ir.Window(array=array, center=center):
                whole = self._lower(array, label, loops)
                (middle,) = self._lower(center, label, loops)
                window = self._indices(e, len(whole), middle)
                chosen = tuple(self._pick(whole, i) for i in window)
                best = index_of(function, tuple(x.value for x in chosen))
                place = self.expressions.place_in_window(e, tuple(i.value for i in window), best, len(whole))
                return KnownOp(place, self._all_known(chosen))
            case _:
                chosen = self._lower(e, label, loops)
                places = tuple(builder.literal(float(i)) for i in range(len(chosen)))
        position = index_of(function, tuple(x.value for x in chosen))
        return KnownOp(self.expressions.pick(places, position), self._all_known(chosen))

    def _reduce(self, e: ir.Reduce, label: str, loops: Loops) -> KnownOp:
        builder, pairs = self.builder, list[tuple[KnownOp, KnownOp]]()
        always = KnownOp(builder.literal(True), builder.literal(True))
        arrays = {name: self._lower(array, label, loops) for name, array in e.arrays}
        for k in range(e.low, e.high + 1):
            inner = (*loops, LoweredRound(e.variable, k, {name: array[k] for name, array in arrays.items()}))
            (body,) = self._lower(e.body, label, inner)
            (condition,) = (always,) if e.condition is None else self._lower(e.condition, label, inner)
            pairs.append((condition, body))
        match e.function:
            case Function.ANY:
                return self._any([self._all(pair) if e.condition else pair[1] for pair in pairs])
            case Function.ALL:
                implied = [self._any((self._strict(builder.negation, c), b)) for c, b in pairs]
                return self._all(implied if e.condition else [body for _, body in pairs])
            case _:
                value = self.expressions.reduction_of(
                    e.function, [b.value for _, b in pairs], [c.value for c, _ in pairs]
                )
                return KnownOp(value, self._all_known([x for pair in pairs for x in pair]))

    # --- memory ----------------------------------------------------------------------------------

    def _memory(
        self, e: ir.MemoryCall, arguments: list[KnownValues], label: str, loops: Loops
    ) -> KnownValues:
        """Lower a memory function, whose memory moves on where its arguments are known."""
        size = max((len(a) for a in arguments), default=1)
        results = []
        for i in range(size):
            x = [a[i] if len(a) > 1 else a[0] for a in arguments]
            known = self._all_known(x)
            scope = LoweringScope(owner=None, label=label, ready=known, loops=_indices_of(loops))
            element = self.expressions.memory(e, tuple(v.value for v in x), scope, i, size)
            results.append(KnownOp(element, known))
        return tuple(results)


def _indices_of(loops: Loops) -> tuple[tuple[str, int], ...]:
    return tuple((turn.variable, turn.k) for turn in loops)


def _each(function: Callable[..., KnownOp], *operands: KnownValues) -> KnownValues:
    """Apply a function to the operands, element by element; a scalar is repeated for all elements."""
    size = max(len(x) for x in operands)
    return tuple(function(*[x[i] if len(x) > 1 else x[0] for x in operands]) for i in range(size))


# --- lower --------------------------------------------------------------------------------------------


def lower(program: program_ir.Program, clients: ClientList, traversal: ClientList | None = None) -> Compiled:
    """Lower all of a program: every actuator with all of its clients, every Python module, the contracts.

    Near-linear in the size of the program and its clients.

    Args:
        program: the program.
        clients: its clients.
        traversal: its clients before simplification; `clients` by default.
    """
    lowering = _Lowering(program, clients)
    for module in program.modules:
        if isinstance(module, program_ir.PythonModule):
            lowering.python_module(module)
    by_actuator = {a.actuator: a.clients for a in clients.actuators}
    for actuator in program.robot.actuators:
        lowering.actuator(actuator, by_actuator.get(actuator.name, ()))
    lowering.states()
    lowering.decided = len(lowering.builder.ops)
    lowering.contracts()
    lowering.states()
    lowering.variants(clients, traversal or clients)
    lowering.states()
    code, robot = trimmed(lowering.code(), every_sensor=True), program.robot
    return Compiled(name=robot.name, frame_ns=robot.frame_ns, code=code)


class _Lowering(Declarations):
    """A program being lowered to one `Code`. Mutable."""

    def __init__(self, program: program_ir.Program, clients: ClientList) -> None:
        super().__init__(program, clients)
        self.decided = 0
        self._lowered_contracts = ContractLowering(self.expressions, self)
        self._python: list[PythonCall] = []
        self._actuator_codes: list[ActuatorCode] = []
        self._contracts: list[ContractCode] = []

    def code(self) -> Code:
        return Code(
            ops=tuple(self.builder.ops),
            kinds=tuple(self.builder.kinds),
            decided=self.decided,
            sensors=self.program.robot.sensors,
            cells=self.builder.cells(),
            python=tuple(self._python),
            actuators=tuple(self._actuator_codes),
            contracts=tuple(self._contracts),
            names=self.builder.names,
            memory_cells=self.builder.places,
        )

    # --- Python modules --------------------------------------------------------------------------

    def python_module(self, module: program_ir.PythonModule) -> None:
        """Lower the readings of a Python module, and record its call."""
        reads = [r.expression for r in module.reads]
        self.prepare(*reads)
        scope = self.file_scope(module.name, tuple(reads))
        call = PythonCall(
            module=module.name,
            module_path=module.module_path,
            class_name=module.class_name,
            params=module.params,
            present=scope.ready,
            reads=tuple(self._read(reading, scope) for reading in module.reads),
            fields=self.actuators[module.actuator].fields if module.actuator else (),
            rate_ns=module.rate_ns,
            span=module.span,
        )
        self._python.append(call)

    def _read(self, reading: program_ir.PythonReading, scope: LoweringScope) -> PythonRead:
        elements = self.expressions.lower(reading.expression, scope)
        return PythonRead(
            name=reading.name, elements=elements, array=isinstance(reading.expression.type, Array)
        )

    # --- actuators and contracts -----------------------------------------------------------------

    def actuator(self, actuator: program_ir.Actuator, clients: tuple[Client, ...]) -> None:
        self._actuator_codes.append(
            ActuatorCode(
                actuator=actuator,
                clients=tuple(self._client(client) for client in clients),
                limits=tuple(
                    self._limit(i, limit)
                    for i, limit in enumerate(self.program.limits)
                    if limit.actuator == actuator.name
                ),
            )
        )

    def _command(self, name: str) -> tuple[int, ...]:
        module = self.modules[name]
        match module:
            case program_ir.Module(command=command):
                assert command is not None, "a client's module commands its actuator"
                self.prepare(*command.fields)
                scope = self.module_scope(module, name)
                return tuple(self.expressions.scalar(field, scope) for field in command.fields)
            case program_ir.PythonModule(actuator=actuator):
                assert actuator is not None, "a client's module commands its actuator"
                fields = self.actuators[actuator].fields
                return tuple(
                    self.builder.add(PythonField(name, i), kind_of(f.type)) for i, f in enumerate(fields)
                )
            case _:
                assert_never(module)

    def _client(self, client: Client) -> ClientCode:
        guard, exclusive = self.guards.guard(client.guard), self.guards.guard(client.exclusive)
        module = self.modules[client.module]
        match module:
            case program_ir.Module():
                present = self.module_present(module.name)
            case program_ir.PythonModule():
                present = self.module_active(module.name)
            case _:
                assert_never(module)
        return ClientCode(
            module=client.module,
            priority=client.priority,
            present=present,
            known=self.module_known(client.module),
            active=self.module_active(client.module),
            guard=guard,
            exclusive=exclusive,
            fields=self._command(client.module),
            loss_aware_guard=guard,
            loss_aware_exclusive=exclusive,
            unsimplified=guard,
            has_several_paths=client.has_several_paths,
            span=module.span,
        )

    def _limit(self, number: int, limit: program_ir.Limit) -> LimitCode:
        builder = self.builder
        name = f"limit {number}"
        self.prepare(limit.bound)
        bound_scope = self.file_scope(f"{name} bound", (limit.bound,))
        bound = self.expressions.scalar(limit.bound, bound_scope)
        missing = [builder.negation(bound_scope.ready)]
        condition = builder.literal(True)
        if limit.condition is not None:
            self.prepare(limit.condition)
            condition_scope = self.file_scope(f"{name} condition", (limit.condition,))
            condition = self.expressions.scalar(limit.condition, condition_scope)
            missing.append(builder.negation(condition_scope.ready))
        sound = builder.both(bound_scope.ready, builder.apply(Operator.FINITE, bound))
        idle = self.actuators[limit.actuator].idle
        if idle is not None:
            bound = builder.apply(Operator.SELECT, sound, bound, builder.literal(idle[limit.field_index]))
        return LimitCode(
            field_index=limit.field_index,
            relation=limit.relation,
            applies=builder.either(*missing, condition),
            bound=bound,
            known=sound if idle is None else builder.literal(True),
        )

    def contracts(self) -> None:
        for contract in self.program.contracts:
            self.prepare(contract.expression)
            holds = self._lowered_contracts.holds(contract.expression, f"contract {contract.name}")
            self._contracts.append(
                ContractCode(
                    name=contract.name,
                    holds=holds,
                    unsimplified=holds,
                    in_time=in_time(self.program.robot, contract),
                    assumed=contract.is_assumption,
                )
            )

    # --- variants of guards ----------------------------------------------------------------------

    def variants(self, clients: ClientList, traversal: ClientList) -> None:
        """Lower guards that exclude lost clients, and whatever depends on guards before simplification.

        This comes last, so that the rest of the code is the same with and without variants.
        """
        guards = {(a.actuator, c.module): c for a in clients.actuators for c in a.clients}
        loss_aware = GuardLowering(self.builder, clients, self.active_unless_lost, "heard guard")
        for i, actuator_code in enumerate(self._actuator_codes):
            if actuator_code.actuator.on_loss == "degrade":
                self._actuator_codes[i] = replace(
                    actuator_code,
                    clients=tuple(
                        self._with_loss_aware_guards(
                            c, guards[actuator_code.actuator.name, c.module], loss_aware
                        )
                        for c in actuator_code.clients
                    ),
                )
        if traversal is clients:
            return
        traversed_guards = {(a.actuator, c.module): c.guard for a in traversal.actuators for c in a.clients}
        self.guards = unsimplified = GuardLowering(
            self.builder, traversal, self.module_active, "traversed guard"
        )
        for i, actuator_code in enumerate(self._actuator_codes):
            self._actuator_codes[i] = replace(
                actuator_code,
                clients=tuple(
                    replace(
                        c,
                        unsimplified=unsimplified.guard(
                            traversed_guards[actuator_code.actuator.name, c.module]
                        ),
                    )
                    for c in actuator_code.clients
                ),
            )
        for i, (contract, code) in enumerate(zip(self.program.contracts, self._contracts, strict=True)):
            if self.observes(contract.expression):
                label = f"traversed contract {code.name}"
                holds = self._lowered_contracts.holds(contract.expression, label)
                self._contracts[i] = replace(code, unsimplified=holds)

    def _with_loss_aware_guards(self, code: ClientCode, client: Client, guards: GuardLowering) -> ClientCode:
        """Return the client with guards in which lost clients are not active.

        A lost failsafe one counts as active to others; it does not act itself.
        """
        here = self.builder.literal(True)
        if self.modules[client.module].failsafe:
            here = self.builder.negation(self.builder.add(Lost(client.module), Kind.BOOL))
        return replace(
            code,
            loss_aware_guard=self.builder.both(guards.guard(client.guard), here),
            loss_aware_exclusive=self.builder.both(guards.guard(client.exclusive), here),
        )
