"""The subject of the lints: a program whose nodes and commands have names, and facts about it."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

from colony.ir import expression as ir
from colony.ir.expression import Binary, Expression
from colony.ir.program import (
    Actuator,
    ActuatorField,
    AnyModule,
    Derived,
    Let,
    Limit,
    Machine,
    Module,
    Program,
    Use,
    Wire,
    Wiring,
)
from colony.ir.types import BOOL, ScalarValue
from colony.ir.walk import WiringNode, wiring_graph
from colony.text.source import Source, Span
from colony.text.wording import duration_text
from colony.verify.claims import (
    FALSE,
    TRUE,
    active,
    all_of,
    any_of,
    binary,
    constant,
    implies,
    negation,
    value_or,
)
from colony.verify.difference.content import Contents, ContentTable

# --- bounds -------------------------------------------------------------------------------------------
#
# The bounds of a field in a frame as expressions, so that claims can compare them.
#
# Each bound and condition of a limit becomes a let of the instrumented program, which the limit reads in its
# place: its memory exists once, and claims can read it too.


@dataclass(frozen=True, slots=True, kw_only=True)
class FieldBound:
    """A bound of a field: of a limit, or of the range if `limit` is None.

    Attributes:
        is_upper: True for an upper bound.
        applies: The condition that it applies.
        known: The condition that it has a value. Only on `idle hold` may it have none where it applies.
        value: The bound in base units; the idle command's value where the limit's is missing or not finite.
        constant: The value, if it is constant.
        limit: The limit.
    """

    is_upper: bool
    applies: Expression = TRUE
    known: Expression = TRUE
    value: Expression
    constant: float | None
    limit: Limit | None = None


def with_named_bounds(program: Program) -> Program:
    """Return the program with a let for each bound and condition of a limit, which the limit reads."""
    lets: list[Let] = []
    limits = []
    for i, limit in enumerate(program.limits):
        bound, condition = limit.bound, limit.condition
        if not isinstance(bound, ir.Constant):
            lets.append(Let(name=_bound_name(i), expression=bound))
            bound = ir.DerivedValue(type=bound.type, name=_bound_name(i))
        if condition is not None:
            lets.append(Let(name=limit_condition_name(i), expression=condition))
            condition = ir.DerivedValue(type=BOOL, name=limit_condition_name(i))
        limits.append(replace(limit, bound=bound, condition=condition))
    return replace(program, derived=(*program.derived, *lets), limits=tuple(limits))


def _bound_name(i: int) -> str:
    """Return the name of the let for the bound of a limit; names of the language have no blanks."""
    return f"limit {i}"


def limit_condition_name(i: int) -> str:
    """Return the name of the let for the condition of a limit."""
    return f"limit {i} when"


def all_bounds(program: Program, actuator: Actuator, i: int) -> tuple[FieldBound, ...]:
    """Return the bounds of field `i` of an actuator: of its range, then of its limits as written."""
    of_limits = (
        _of_limit(limit, number, actuator)
        for number, limit in enumerate(program.limits)
        if limit.actuator == actuator.name and limit.field_index == i
    )
    return (*_of_range(actuator.fields[i]), *of_limits)


def _of_range(field: ActuatorField) -> Iterator[FieldBound]:
    for value, is_upper in ((field.low, False), (field.high, True)):
        if value is not None:
            yield FieldBound(is_upper=is_upper, value=constant(value, field.type), constant=value)


def _of_limit(limit: Limit, number: int, actuator: Actuator) -> FieldBound:
    is_upper = limit.relation == "<="
    applies: Expression = TRUE
    if limit.condition is not None:
        asked = ir.DerivedValue(type=BOOL, name=limit_condition_name(number))
        applies = value_or(asked, TRUE)
    if isinstance(limit.bound, ir.Constant):
        known_value = float(limit.bound.value)  # type: ignore[arg-type]  # a limit bounds a scalar
        return FieldBound(
            is_upper=is_upper, applies=applies, value=limit.bound, constant=known_value, limit=limit
        )
    name = _bound_name(number)
    if applies is not TRUE:
        applies = any_of((negation(ir.Fresh(type=BOOL, name=name, derived=True)), applies))
    computed: Expression = ir.DerivedValue(type=limit.bound.type, name=name)
    known = value_or(is_finite(computed), FALSE)
    idle_value = 0.0 if actuator.idle is None else actuator.idle[limit.field_index]
    idle = constant(idle_value, actuator.fields[limit.field_index].type)
    finite = ir.Conditional(type=computed.type, condition=is_finite(computed), yes=computed, no=idle)
    value = value_or(finite, idle)
    return FieldBound(
        is_upper=is_upper,
        applies=applies,
        known=known if actuator.idle is None else TRUE,
        value=value,
        constant=None,
        limit=limit,
    )


def is_finite(e: Expression) -> Expression:
    """Return the condition that a number is neither infinite nor NaN."""
    low, high = (constant(x, e.type) for x in (-sys.float_info.max, sys.float_info.max))  # type: ignore[arg-type]
    return ir.Within(type=BOOL, operand=e, low=low, high=high)


def contradiction(bounds: Sequence[FieldBound]) -> Expression:
    """Return the condition that a lower bound is above an upper one; the constant false if it cannot be."""
    found = []
    for low in bounds:
        for high in bounds:
            if low.is_upper or not high.is_upper or _agree(low, high):
                continue
            exceeds = binary(Binary.GREATER, low.value, high.value)
            found.append(all_of(x for x in (low.applies, high.applies, exceeds) if x is not TRUE))
    return any_of(found)


def _agree(low: FieldBound, high: FieldBound) -> bool:
    """Return True if a lower and an upper bound are constants that do not contradict each other."""
    if low.limit is None and high.limit is None:
        return True
    return low.constant is not None and high.constant is not None and low.constant <= high.constant


def exclusion(bounds: Sequence[FieldBound], idle: float, field: ActuatorField) -> Expression:
    """Return the condition that a limit excludes the idle command's value; the constant false if none can."""
    found = []
    for bound in bounds:
        if bound.limit is None or (bound.constant is not None and _allows(bound, idle)):
            continue
        operator = Binary.LESS if bound.is_upper else Binary.GREATER
        excludes = binary(operator, bound.value, constant(idle, field.type))
        found.append(all_of(x for x in (bound.applies, excludes) if x is not TRUE))
    return any_of(found)


def _allows(bound: FieldBound, idle: float) -> bool:
    assert bound.constant is not None
    return idle <= bound.constant if bound.is_upper else idle >= bound.constant


def all_known(bounds: Sequence[FieldBound]) -> Expression:
    """Return the condition that every bound that applies has a value."""
    return all_of(
        b.known if b.applies is TRUE else implies(b.applies, b.known) for b in bounds if b.known is not TRUE
    )


# --- network ------------------------------------------------------------------------------------------
#
# The network with a name for every node, so that claims can refer to nodes.


@dataclass(frozen=True, slots=False, kw_only=True)
class NamedNetwork:
    """The network of a program in which every node is a wire of its own.

    Attributes:
        wires: one wire for each node, then the wires of the program.
        nodes: the suppressors and inhibitors with a path to an actuator, by name, each after its inputs.
        roots: the module or node that drives each wired actuator.
    """

    wires: tuple[Wire, ...]
    nodes: dict[str, WiringNode]
    roots: Mapping[str, str]
    _modules_under: dict[str, tuple[str, ...]] = field(default_factory=dict, init=False, repr=False)
    _dominators: dict[str, tuple[str, ...]] = field(default_factory=dict, init=False, repr=False)

    @cached_property
    def _numbers(self) -> dict[str, int]:
        """The number of each module."""
        numbers: dict[str, int] = {}
        for node in self.nodes.values():
            for name in (node.dominant, node.inferior):
                if name not in self.nodes:
                    numbers.setdefault(name, len(numbers))
        for name in self.roots.values():
            if name not in self.nodes:
                numbers.setdefault(name, len(numbers))
        return numbers

    @cached_property
    def _sets_under(self) -> dict[str, int]:
        """The modules below each node as a set of bits, by number, which takes little space."""
        sets = {module: 1 << number for module, number in self._numbers.items()}
        for node in self.nodes.values():
            sets[node.name] = sets[node.dominant] | sets[node.inferior]
        return sets

    @cached_property
    def _sets_above(self) -> dict[str, int]:
        """The modules that dominate each module or node somewhere, as a set of bits."""
        sets: dict[str, int] = {}
        for node in reversed(self.nodes.values()):
            above = sets.get(node.name, 0)
            sets[node.dominant] = sets.get(node.dominant, 0) | above
            sets[node.inferior] = sets.get(node.inferior, 0) | above | self._sets_under[node.dominant]
        return sets

    def set_of(self, modules: Iterable[str]) -> int:
        """Return wired modules as a set of bits."""
        return sum(1 << self._numbers[m] for m in dict.fromkeys(modules) if m in self._numbers)

    def dominates(self, modules: int, module: str) -> bool:
        """Return True if one of a set of other modules (`set_of`) dominates a module somewhere."""
        others = modules & ~(1 << self._numbers[module])
        return bool(self._sets_above.get(module, 0) & others)

    def is_under(self, module: str, ref: str) -> bool:
        """Return True if a module is below a node, or is `ref` itself."""
        number = self._numbers.get(module)
        return number is not None and bool(self._sets_under[ref] >> number & 1)

    def modules_under(self, ref: str) -> tuple[str, ...]:
        """Return the modules below a node, dominant ones first, or the module itself."""
        if ref not in self._modules_under:
            self._modules_under[ref] = self._find_modules_under(ref)
        return self._modules_under[ref]

    def _find_modules_under(self, ref: str) -> tuple[str, ...]:
        modules: dict[str, None] = {}
        pending, seen = [ref], set[str]()
        while pending:
            name = pending.pop()
            if name in seen:
                continue
            seen.add(name)
            if name in self.nodes:
                pending += [self.nodes[name].inferior, self.nodes[name].dominant]
            else:
                modules[name] = None
        return tuple(modules)

    def output_condition(self, module: str, ref: str, depth: int = 0) -> ir.Expression | None:
        """Return the condition that `module`'s output is on `ref`, None if the network is too deep."""
        if ref not in self.nodes:
            return active(module) if ref == module else FALSE
        if not self.is_under(module, ref):
            return FALSE
        if depth >= _MAX_DEPTH:
            return None
        node = self.nodes[ref]
        inferior_condition = self.output_condition(module, node.inferior, depth + 1)
        if inferior_condition is None:
            return None
        if node.relation == "inhibits":
            return FALSE if inferior_condition is FALSE else all_of((active(ref), inferior_condition))
        dominant_condition = self.output_condition(module, node.dominant, depth + 1)
        if dominant_condition is None:
            return None
        passed = (
            []
            if inferior_condition is FALSE
            else [all_of((active(ref), negation(active(node.dominant)), inferior_condition))]
        )
        return any_of((*([] if dominant_condition is FALSE else [dominant_condition]), *passed))

    def nodes_above(self, module: str) -> Iterator[WiringNode]:
        """Yield the nodes on whose inferior side a module is."""
        return (node for node in self.nodes.values() if self.is_under(module, node.inferior))

    def dominators(self, module: str) -> tuple[str, ...]:
        """Return the other modules that dominate a module, in the order of the nodes at which they do."""
        if module not in self._dominators:
            found: dict[str, None] = {}
            for node in self.nodes_above(module):
                found |= dict.fromkeys(self.modules_under(node.dominant))
            found.pop(module, None)
            self._dominators[module] = tuple(found)
        return self._dominators[module]


_MAX_DEPTH = 24


def network(program: Program) -> NamedNetwork:
    """Return the network of `program`, with a wire for every node."""
    graph = wiring_graph(program)
    reached = set(graph.roots.values())
    for node in reversed(graph.nodes):
        if node.name in reached:
            reached |= {node.dominant, node.inferior}
    targets = {
        w.name: graph.wires[w.name] if w.actuator is None else graph.roots[w.actuator] for w in program.wires
    }
    node_wires = (node.wire(node.name, node.dominant, node.inferior) for node in graph.nodes)
    program_wires = (replace(wire, wiring=Use(name=targets[wire.name])) for wire in program.wires)
    nodes = {node.name: node for node in graph.nodes if node.name in reached}
    return NamedNetwork(wires=(*node_wires, *program_wires), nodes=nodes, roots=graph.roots)


def span_of(node: WiringNode) -> Span:
    """Return the span of a node: from its dominant operand to the end of its chain."""
    first, last = node.chain.operands[node.index].span, node.chain.operands[-1].span
    return Span(first.source, first.start, max(last.end, first.end))


def text_of(node: WiringNode) -> str:
    """Return the source text of a node, without the contents of parentheses."""
    dominant, inferior, *further = node.chain.operands[node.index :]
    window = f"[{duration_text(node.window_ns)}]" if node.window_ns else ""
    text = f"{_short(dominant)} {node.relation}{window} {_short(inferior)}"
    return f"{text} ..." if further else text


def _short(wiring: Wiring) -> str:
    return wiring.name if isinstance(wiring, Use) else "(...)"


# --- case ---------------------------------------------------------------------------------------------

_READING = (ir.SensorValue, ir.DerivedValue, ir.LocalValue, ir.StateValue, ir.Fresh, ir.RestartedFlag)


@dataclass(frozen=True, slots=False, kw_only=True)
class Case:
    """The subject of the lints.

    `instrumented` is `program` without contracts and tests, but with a wire for each node and a let for each
    field of a module's command (`command_of`), each condition of a machine (`condition_of`) and each bound of
    a limit, so that claims can name them.
    """

    program: Program
    instrumented: Program
    network: NamedNetwork

    @cached_property
    def contents(self) -> Contents:
        """The contents of the program's declarations."""
        return Contents(self.program, ContentTable())

    @cached_property
    def actuators(self) -> dict[str, Actuator]:
        """The actuators by name."""
        return {a.name: a for a in self.program.robot.actuators}

    @cached_property
    def wired_modules(self) -> dict[str, AnyModule]:
        """The modules that reach an actuator, by name."""
        wired = {m for root in self.network.roots.values() for m in self.network.modules_under(root)}
        return {m.name: m for m in self.program.modules if m.name in wired}

    @cached_property
    def modules(self) -> dict[str, Module]:
        """Those of `wired_modules` that are written in the language."""
        return {name: m for name, m in self.wired_modules.items() if isinstance(m, Module)}

    @cached_property
    def main_file(self) -> Source | None:
        """The file that drives the actuators."""
        return next((w.span.source for w in self.program.wires if w.actuator is not None), None)

    def is_own(self, span: Span) -> bool:
        """Return True if a span is in the main file; findings in imported files are left out."""
        return span.source is self.main_file

    @cached_property
    def own_modules(self) -> dict[str, Module]:
        """The modules of the main file, by name."""
        return {name: m for name, m in self.modules.items() if self.is_own(m.span)}

    def reads(self, *expressions: ir.Expression) -> Iterator[ir.Expression]:
        """Yield the subexpressions of expressions and of the lets that they read."""
        pending, seen = list(expressions), set[str]()
        while pending:
            for x in ir.subexpressions(pending.pop()):
                yield x
                if isinstance(x, ir.DerivedValue | ir.LocalValue) and x.name not in seen:
                    seen.add(x.name)
                    pending.append(self._lets[x.name].expression)

    @cached_property
    def _lets(self) -> dict[str, Let]:
        of_modules = (let for m in self.program.modules if isinstance(m, Module) for let in m.lets)
        of_files = (d for d in self.program.derived if isinstance(d, Let))
        return {let.name: let for let in (*of_files, *of_modules)}

    def has_inputs(self, module: Module) -> bool:
        """Return True if a module's predicate reads anything."""
        return any(isinstance(x, _READING) for x in ir.subexpressions(module.when))


def case_of(program: Program) -> Case:
    """Return the case of a program."""
    named_network = network(program)
    modules = tuple(_instrumented(m) if isinstance(m, Module) else m for m in program.modules)
    instrumented = replace(program, modules=modules, wires=named_network.wires, contracts=(), tests=())
    instrumented = with_named_bounds(_with_named_conditions(instrumented))
    return Case(program=program, instrumented=instrumented, network=named_network)


def command_of(module: Module, i: int) -> ir.Expression:
    """Return field `i` of a module's command, as claims refer to it; missing where the module is silent."""
    assert module.command is not None
    return ir.LocalValue(type=module.command.fields[i].type, name=f"{module.name}. {i}")


def condition_of(machine: Machine, i: int) -> ir.DerivedValue:
    """Return the condition of transition `i` of a machine, as claims refer to it."""
    return ir.DerivedValue(type=BOOL, name=f"{machine.name}. {i}")


def _with_named_conditions(program: Program) -> Program:
    """Return the program with a let for the condition of each transition, which the transition reads."""
    derived: list[Derived] = []
    for item in program.derived:
        if isinstance(item, Machine):
            conditions = tuple(condition_of(item, i) for i in range(len(item.transitions)))
            pairs = tuple(zip(item.transitions, conditions, strict=True))
            derived += (Let(name=c.name, expression=t.condition) for t, c in pairs)
            item = replace(item, transitions=tuple(replace(t, condition=c) for t, c in pairs))
        derived.append(item)
    return replace(program, derived=tuple(derived))


def _instrumented(module: Module) -> Module:
    if module.command is None:
        return module
    fields = module.command.fields
    field_lets = tuple(Let(name=f"{module.name}. {i}", expression=e) for i, e in enumerate(fields))
    values = tuple(command_of(module, i) for i in range(len(fields)))
    return replace(module, lets=(*module.lets, *field_lets), command=replace(module.command, fields=values))


def value_text(x: ScalarValue, field: ActuatorField) -> str:
    """Return a value of a field in its declared unit."""
    return f"{x / field.factor:.6g}{f' {field.unit}' if field.unit else ''}"
