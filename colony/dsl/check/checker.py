"""The context in which an expression is checked: names in scope, findings, and state shared by all checks.

A check returns the typed expression, or None after it has reported an error. A caller that receives None
continues with the rest, so that one run reports all errors.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from fractions import Fraction

from colony.dsl import ast
from colony.dsl.check.compatibility import (
    constant_value,
    fits,
    literal,
    reads_placeholder,
    unit_of,
    with_article,
)
from colony.dsl.check.scope import (
    ActuatorSymbol,
    BrokenSymbol,
    CheckReport,
    FileScope,
    ValueSymbol,
    is_private,
    label,
    span_of,
)
from colony.ir import expression as ir
from colony.ir import program as program_ir
from colony.ir.types import (
    DIMENSIONLESS,
    Array,
    Bool,
    Quantity,
    Scalar,
    ScalarValue,
    Type,
    element_type,
    is_percent,
    type_text,
)
from colony.text.diagnostics import Label
from colony.text.source import Span
from colony.text.units import TIME, UnitError, common_units, nanoseconds
from colony.text.wording import Remedy, listed

MAX_DURATION_NS = 10**18
"""Maximum duration in nanoseconds, so that sums of times fit 64 bits in every executor."""

CONSTANT_HINT = "use literals, params and arithmetic on them"
"""The hint for an expression that must be constant."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Checker(ABC):
    """The names in scope of an expression, and the report that collects its findings.

    Attributes:
        scope: the names of the file.
        report: the collector of findings.
        local: the names of the module, which hide those of the file.
        in_contract_or_test: True if `by`, `is` and members of modules and actuators are allowed.
        memory: True if memory functions are allowed.
        constants_only: True if the expression must be constant.
        module_names: all names that the module declares, above or below the expression.
        loops: the variables of enclosing reductions, which have unique names in the expression.
        iterations: the number of iterations of all enclosing reductions together.
        taken_loops: unique names that no variable of a reduction may have: those of the callers.
        in_call: True in the body of a function that is called.
        in_function: True in the body of a function that is declared, where parameters have no values.
    """

    scope: FileScope
    report: CheckReport
    local: Mapping[str, ValueSymbol] = field(default_factory=dict)
    in_contract_or_test: bool = False
    memory: bool = True
    constants_only: bool = False
    module_names: frozenset[str] = frozenset()
    loops: Mapping[str, ir.LoopIndex | ir.LoopElement] = field(default_factory=dict)
    iterations: int = 1
    taken_loops: frozenset[str] = frozenset()
    in_call: bool = False
    in_function: bool = False

    @abstractmethod
    def visit(self, node: ast.Expression) -> ir.Expression | None:
        """Check a subexpression, whose depth `check` has checked."""

    @property
    def taken_names(self) -> frozenset[str]:
        """Return the unique names of the variables of all reductions around, those of callers included."""
        return self.taken_loops.union(loop.name for loop in self.loops.values())

    # --- entry points

    def check(self, node: ast.Expression) -> ir.Expression | None:
        """Check an expression of any type, and return it typed."""
        if node.depth > ir.NESTING_LIMIT:
            message = f"the expression nests {node.depth} levels deep; at most {ir.NESTING_LIMIT} are allowed"
            self.error("E004", node, message, "name parts of it with `let`")
            return None
        return self.visit(node)

    def expect(self, node: ast.Expression, expected: Type, what: str) -> ir.Expression | None:
        """Check that an expression's type is `expected`; `what` names the expression in messages."""
        found = self.check(node)
        if found is None:
            return None
        if fits(found.type, expected):
            return found
        hint = type_hint(node, found.type, expected)
        self.error(
            "E202", node, f"{what} must be {with_article(expected)}, found {with_article(found.type)}", hint
        )
        return None

    def constant(
        self, node: ast.Expression, expected: Scalar | None, what: str, hint: str | None = None
    ) -> ir.Constant | None:
        """Check a finite constant of type `expected` (any scalar type if None).

        `hint` is for a value that is not constant.
        """
        constants = replace(self, memory=False, constants_only=True)
        found = constants.check(node) if expected is None else constants.expect(node, expected, what)
        if found is None:
            return None
        value = constant_value(found)
        if self.in_function and value is None and reads_placeholder(found):
            return None  # each call decides
        if value is None or isinstance(found.type, Array):
            hint = hint or CONSTANT_HINT
            self.error("E204", node, f"{what} must be constant", hint)
            return None
        if not abs(value) < float("inf"):
            self.error("E212", node, f"{what} is not a finite number")
            return None
        type_ = found.type if expected is None or not isinstance(found.type, Quantity) else expected
        return ir.Constant(type=type_, value=value, span=found.span)

    def constant_in(self, node: ast.Expression, type_: Scalar, unit: str, what: str) -> ScalarValue | None:
        """Check a constant of `type_`; a plain number is in the declared unit.

        In `percent`, which has no dimension, only a literal is: what is computed may be 20 percent.
        """
        sign, unsigned = 1.0, node
        while isinstance(unsigned, ast.Prefix) and unsigned.operator == "-":
            sign, unsigned = -sign, unsigned.operand
        if isinstance(type_, Quantity) and isinstance(unsigned, ast.NumberNode) and unsigned.unit is None:
            value = self.literal(unsigned, unit)
            return None if value is None else sign * value
        if isinstance(type_, Quantity) and not type_.wildcard:
            found = self.constant(node, None, what)
            if found is None:
                return None
            if fits(found.type, type_):  # so is any number that is computed, if `type_` has no dimension
                return found.value  # type: ignore[return-value]
            is_plain = isinstance(found.type, Quantity) and found.type.dimension == DIMENSIONLESS.dimension
            if is_plain and type_ != DIMENSIONLESS:
                return float(found.value) * float(unit_of(unit).factor) if unit else found.value  # type: ignore[arg-type,return-value]
            message = f"{what} must be {with_article(type_)}, found {with_article(found.type)}"
            self.error("E202", node, message, percent_hint((node, found.type), (node, type_)))
            return None
        found = self.constant(node, type_, what)
        return None if found is None else found.value  # type: ignore[return-value]

    def duration_ns(self, node: ast.Expression, what: str) -> int | None:
        """Return a non-negative constant time in whole nanoseconds."""
        is_negative = (
            isinstance(node, ast.Prefix)
            and node.operator == "-"
            and isinstance(node.operand, ast.NumberNode)
            and float(node.operand.digits) > 0.0
        )
        found = None if is_negative else self.constant(node, Quantity(TIME), what)
        ns = -1 if is_negative else 0 if found is None else nanoseconds(found.value)  # type: ignore[arg-type]
        if ns < 0:
            self.error("E213", node, f"{what} is negative", "a duration is at least 0")
            return None
        if found is None:
            return None
        if ns > MAX_DURATION_NS:
            years = MAX_DURATION_NS // (365 * 86_400 * 10**9)
            self.error("E213", node, f"{what} is longer than {years} years")
            return None
        return ns

    def whole(self, node: ast.Expression, what: str, low: int, high: int) -> int | None:
        """Return a constant whole number from `low` to `high`."""
        found = self.constant(node, DIMENSIONLESS, what)
        if found is None:
            return None
        value = found.value
        if not isinstance(value, float) or value != int(value) or not low <= value <= high:
            shown = f"{value:g}" if isinstance(value, float) else str(value).lower()
            self.error("E214", node, f"{what} must be a whole number from {low} to {high}, found {shown}")
            return None
        return int(value)

    # --- helpers

    def error(
        self, code: str, node: ast.SyntaxNode, message: str, hint: str | None = None, *labels: Label
    ) -> None:
        """Report an error at a node of this scope's file."""
        self.report.error(self.scope, code, node, message, hint, *labels)

    def label(self, node: ast.SyntaxNode) -> Label:
        """Return a label for a first declaration in this file."""
        return label(self.scope, node)

    def span(self, node: ast.SyntaxNode) -> Span:
        """Return the span of a node in this scope's file."""
        return span_of(self.scope, node)

    def literal(self, node: ast.NumberNode, unit: str | None) -> float | None:
        """Return the value of a number in base units, or None after reporting an error."""
        try:
            factor = unit_of(unit).factor if unit else Fraction(1)
        except UnitError as problem:
            self.error("E011", node, str(problem))
            return None
        value = literal(node.digits, factor)
        if value is None:
            self.error("E010", node, "the number is too large for a 64-bit float")
        return value

    def broadcast(self, node: ast.SyntaxNode, element: Scalar, *types: Type) -> Type | None:
        """Return `element`, or an array of it: scalars fit any array, arrays must agree in length.

        The array has the bearings of `types` if all arrays have the same.
        """
        sizes = sorted({t.size for t in types if isinstance(t, Array)})
        if len(sizes) > 1:
            shown = " and ".join(str(s) for s in sizes)
            self.error("E206", node, f"the arrays differ in length: {shown} elements")
            return None
        found = {t.bearings for t in types if isinstance(t, Array)}
        return Array(element, sizes[0], found.pop() if len(found) == 1 else None) if sizes else element

    def array(self, node: ast.Expression) -> ir.Expression | None:
        """Check an expression that must be an array."""
        found = self.visit(node)
        if found is not None and not isinstance(found.type, Array):
            self.error("E207", node, f"expected an array, found {with_article(found.type)}")
            return None
        return found


def type_hint(node: ast.Expression, found: Type, expected: Type) -> str | None:
    """Return a hint for an expression whose type is not the expected one, if there is one."""
    hint = percent_hint((node, found), (node, expected))
    if hint is not None:
        return hint
    if isinstance(found, Array) and not isinstance(expected, Array):
        if isinstance(expected, Bool):
            return "reduce the array with `any(...)` or `all(...)`"
        return "take an element, or reduce the array with `min`, `max`, `mean` or `sum`"
    if not isinstance(found, Quantity) or not isinstance(expected, Quantity):
        return None
    sign, number = "", node
    if isinstance(node, ast.Prefix) and node.operator == "-":
        sign, number = "-", node.operand
    if isinstance(number, ast.NumberNode) and number.unit is None:
        return unit_hint(f"{sign}{number.digits}", expected)
    if found == DIMENSIONLESS:
        units = [f"`1 {unit}`" for unit in common_units(expected.dimension)]
        return f"give it a unit: times {listed(units, 'or')}"
    if expected == DIMENSIONLESS:
        return f"divide by a unit for a plain number: `x / 1 {type_text(found)}`"
    return None


def short_number(number: str) -> str:
    """Return a number as a hint repeats it: its beginning, if it is long."""
    return number if len(number) <= 20 else f"{number[:20]}..."


def percent_hint(*parts: tuple[ast.Expression, Type]) -> str | None:
    """Return how to write a number that is used with values in percent; None if no plain one is.

    Args:
        parts: expressions that must be of one type, with the types that they have.
    """
    if not any(is_percent(type_) for _, type_ in parts):
        return None
    for node, type_ in parts:
        element = element_type(type_)
        if isinstance(element, Quantity) and element.written == "literal":
            sign, number = "", node
            if isinstance(node, ast.Prefix) and node.operator == "-":
                sign, number = "-", node.operand
            if not isinstance(number, ast.NumberNode):
                return "write its numbers in percent, as in `20 percent`"
            digits = f"{sign}{short_number(number.digits)}"
            whole = f"{float(sign + number.digits) * 100:.15g}"
            hint = f"write `{digits} percent`, or `{whole} percent` for {digits} of the whole"
            of_whole = f"{whole.removeprefix('-')} percent"
            return Remedy(hint, number.digits, f"{number.digits} percent", of_whole)
    return None


def unit_hint(number: str, expected: Quantity) -> str:
    """Return a hint for a number without a unit; which unit was meant, only its author knows."""
    units = common_units(expected.dimension)
    shown = [f"`{short_number(number)} {unit}`" for unit in units]
    digits = number.removeprefix("-")
    return Remedy(f"write its unit: {listed(shown, 'or')}", digits, *(f"{digits} {unit}" for unit in units))


# --- private ------------------------------------------------------------------------------------------
#
# Names that begin with `_`: they belong to their file, and imports do not bring them in.

_HINT = "a name that begins with `_` can be used only in its file"


def reject_private_name(checker: Checker, node: ast.SyntaxNode, scope: FileScope, name: str) -> bool:
    """Report a name that is unknown in a scope because it belongs to another file; return True if so."""
    if not is_private(name) or (scope is checker.scope and scope.declares_private(name)):
        return False
    owner = scope.file.source.name if scope.declares_private(name) else scope.private_owners.get(name)
    if owner is None:
        return False
    checker.error("E110", node, f"`{name}` belongs to `{owner}`", _HINT)
    return True


def reject_private_member(checker: Checker, node: ast.SyntaxNode, home: FileScope | None, name: str) -> bool:
    """Report a member, of a module whose text is in `home`, that belongs to another file."""
    if home is None or not is_private(name) or home.file.key == checker.scope.file.key:
        return False
    checker.error("E110", node, f"`{name}` belongs to `{home.file.source.name}`", _HINT)
    return True


# --- sent ---------------------------------------------------------------------------------------------
#
# Resolution of `last.ACTUATOR.FIELD`: what an actuator was given in the frame before.


def sent_field(checker: Checker, node: ast.Reference) -> program_ir.Sensor | None:
    """Return the sensor `last.ACTUATOR.FIELD` of the program, or None after reporting an error."""
    robot = checker.scope.robot
    if len(node.path) != 3:
        actuator = min(robot.actuator_names, default="ACTUATOR")
        if len(node.path) > 1 and node.path[1] in robot.actuator_names:
            actuator = node.path[1]
        hint = f"name an actuator and one of its fields: `last.{actuator}.FIELD`"
        checker.error("E108", node, f"`{node.text}` is no field of an actuator", hint)
        return None
    _, name, field = node.path
    symbol = robot.network_symbols.get(name)
    if not isinstance(symbol, ActuatorSymbol):
        if not isinstance(symbol, BrokenSymbol) and not checker.scope.may_be_lost(name):
            similar = checker.report.suggest(name, robot.actuator_names)
            checker.error("E402", node, f"unknown actuator `{name}`", similar)
        return None
    fields = [f.name for f in symbol.actuator.fields]
    if field not in fields:
        shown = checker.report.suggest(field, fields) or f"it has {', '.join(fields)}"
        checker.error("E108", node, f"actuator `{name}` has no field `{field}`", shown)
        return None
    sensor = program_ir.sent_sensor(symbol.actuator, fields.index(field))
    return robot.sent.setdefault(sensor.name, sensor)
