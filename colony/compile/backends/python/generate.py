"""Generation of a program as one readable Python class, which imports nothing but the standard `math`.

Its `step(t_ns, readings)` returns `(decisions, records, breaches)` as plain tuples, in the order and form of
`colony.ir.frame`. The clients of an actuator are a chain of `if`s in order of priority, which is left
at the first whose guard holds; commands are computed for the winner only. Values with memory are computed in
every frame. A value that is used several times is computed once, before its first use.
"""

from __future__ import annotations

import ast
import inspect
import keyword
import math
import re
from collections.abc import Iterable
from functools import cache
from types import ModuleType

from colony.compile.backends.python import decision
from colony.compile.backends.python.decision import DecisionText
from colony.compile.backends.python.executor import PythonExecutor, load
from colony.compile.backends.python.expressions import ExpressionTexts
from colony.compile.backends.python.plan import (
    ActuatorPlan,
    ClientPlan,
    FunctionLayout,
    GroupPlan,
    Placement,
    ProgramOutline,
    make_plan,
)
from colony.compile.backends.python.text import Precedence, UniqueNames, literal, ranges
from colony.execute import arithmetic, intake, python_step, settle
from colony.execute.code import ClientCode, FrameTime, PythonCall
from colony.execute.compiled import Compiled
from colony.execute.machine import defaults, field_types
from colony.execute.needs import whole_view
from colony.execute.sensors import age_limits
from colony.ir import angles
from colony.ir.program import Role
from colony.ir.version import SEMANTICS
from colony.text.diagnostics import DiagnosticError, error

# --- support ------------------------------------------------------------------------------------------
#
# The source of the functions and classes that generated programs include.
#
# They are those of the plain executor, so that each has a single definition. Annotations are removed, since
# they would need imports.

_MATH = frozenset(name for name in dir(math) if not name.startswith("_"))
_MODULES: tuple[ModuleType, ...] = (angles, arithmetic, intake, python_step, settle)


def support(names: Iterable[str]) -> tuple[list[str], list[str]]:
    """Return the definitions called `names` with their dependencies, and the names needed from `math`.

    `names` may include names from `math`; unknown names are ignored.
    """
    definitions = _definitions()
    needed: set[str] = set()
    pending = list(names)
    while pending:
        name = pending.pop()
        if name not in needed:
            needed.add(name)
            pending.extend(_names_in(definitions[name]) if name in definitions else ())
    texts = [ast.unparse(node) for name, node in definitions.items() if name in needed]
    return texts, sorted(name for name in needed if name in _MATH and name not in definitions)


@cache
def _definitions() -> dict[str, ast.FunctionDef | ast.ClassDef]:
    """Return the definitions by name, dependencies first."""
    definitions: dict[str, ast.FunctionDef | ast.ClassDef] = {}
    for module in _MODULES:
        for node in ast.parse(inspect.getsource(module)).body:
            if isinstance(node, ast.FunctionDef | ast.ClassDef):
                definitions[node.name] = _without_annotations(node)
    return definitions


def _names_in(node: ast.AST) -> set[str]:
    return {n.id for n in ast.walk(node) if isinstance(n, ast.Name)}


def _without_annotations(node: ast.FunctionDef | ast.ClassDef) -> ast.FunctionDef | ast.ClassDef:
    """Return the definition without annotations."""
    stripped = _AnnotationRemover().visit(node)
    assert isinstance(stripped, ast.FunctionDef | ast.ClassDef)
    return stripped


class _AnnotationRemover(ast.NodeTransformer):
    def visit_FunctionDef(self, node: ast.FunctionDef) -> ast.FunctionDef:
        node.returns = None
        self.generic_visit(node)
        return node

    def visit_ClassDef(self, node: ast.ClassDef) -> ast.ClassDef:
        node.bases = [b.value if isinstance(b, ast.Subscript) else b for b in node.bases]
        self.generic_visit(node)
        return node

    def visit_arg(self, node: ast.arg) -> ast.arg:
        node.annotation = None
        return node

    def visit_AnnAssign(self, node: ast.AnnAssign) -> ast.AST | None:
        if node.value is None:
            return None
        return ast.copy_location(ast.Assign([node.target], node.value), node)


def definition_names() -> frozenset[str]:
    """Return the names of all definitions that a generated program may include."""
    return frozenset(_definitions())


# --- generate -----------------------------------------------------------------------------------------

__all__ = ["PythonExecutor", "generate", "load"]


def generate(compiled: Compiled) -> str:
    """Return the source of a Python module with a class `Program`. Near-linear in the size of the program."""
    return _Generator(compiled).source()


class _Generator:
    """A generator of one program. Mutable."""

    def __init__(self, compiled: Compiled) -> None:
        self.title = compiled.name
        self.code = whole_view(compiled.code)
        self.ranges_of_values = ranges(self.code)
        layout = FunctionLayout()
        self.placement = Placement(self.code, layout, self.ranges_of_values)
        self.plan: ProgramOutline = make_plan(self.code, layout, self.placement)
        self.names = UniqueNames(self.code, definition_names())
        self.expressions = ExpressionTexts(self.code, self.placement, self.ranges_of_values, self.names)
        self.lines: list[str] = []
        self.constants = decision.constants(self.code.sensors)
        self.timed = bool(self.code.python) or any(
            isinstance(op, FrameTime) and uses
            for op, uses in zip(self.code.ops, self.placement.uses, strict=True)
        )
        self.sent = [sensor for sensor in self.code.sensors if sensor.sent is not None]
        self.cells = [cell for commit in self.plan.commits for cell in commit.cells]

    def source(self) -> str:
        self.initial()
        self.step()
        body, self.lines = self.lines, []
        words = _words(body)
        constants = [line for line in self.constants if line.partition(" ")[0] in words]
        definitions, from_math = support(words | _words(constants))
        head = [
            f'"""Clients of {_comment(self.title)}, by `colony compile`, semantics version {SEMANTICS}. '
            'Changes here will be lost."""',
            "",
        ]
        if from_math:
            head += [f"from math import {', '.join(from_math)}", ""]
        imports = [self.import_statement(call) for call in self.code.python]
        if imports:
            head += [*imports, ""]
        for definition in definitions:
            head += ["", definition, ""]
        if constants:
            head += ["", *constants]
        return "\n".join([*head, "", "", *body]) + "\n"

    # --- the class -------------------------------------------------------------------------------

    def add(self, indent: int, *lines: str) -> None:
        self.lines.extend(" " * (4 * indent) + line for line in lines)

    def blank(self) -> None:
        self.lines.append("")

    def before(self, slot: int, indent: int) -> None:
        """Add the statements that belong to a slot."""
        self.add(indent, *self.expressions.statements.get(slot, ()))

    def text(self, value: int) -> str:
        return self.expressions.text(value).text

    def import_statement(self, call: PythonCall) -> str:
        parts = (*call.module_path.split("."), call.class_name)
        if not all(part.isidentifier() and not keyword.iskeyword(part) for part in parts):
            raise DiagnosticError(
                [error("E405", call.span, f"`{'.'.join(parts)}` is not the name of a Python class")]
            )
        return f"from {call.module_path} import {call.class_name} as {_class_name(self.names, call)}"

    def initial(self) -> None:
        """Add the class up to `__init__`, which initializes the memory."""
        attributes = [self.names.cells[cell] for cell in self.cells]
        attributes += [self.names.python[call.module] for call in self.code.python]
        attributes += [self.names.last[sensor.name] for sensor in self.sent]
        if self.timed:
            attributes.append("first_ns")
        self.add(0, "class Program:")
        self.add(1, '"""All clients; one frame follows another. It has all of the memory."""')
        self.blank()
        self.add(1, f"__slots__ = ({''.join(f'{a!r}, ' for a in attributes)})")
        self.blank()
        self.add(1, "def __init__(self):")
        if self.timed:
            self.add(2, "self.first_ns = None")
        for cell in self.cells:
            initial = literal(self.code.cells[cell].initial).text
            self.add(2, f"self.{self.names.cells[cell]} = {initial}")
        for call in self.code.python:
            params = ", ".join(f"{name!r}: {decision.values(value)}" for name, value in call.params)
            instance = f"{_class_name(self.names, call)}({f'**{{{params}}}' if params else ''})"
            fields = field_types(call)
            arguments = f"{call.module!r}, {instance}, {fields!r}, {call.rate_ns}"
            if left_out := defaults(call):
                arguments += f", {left_out!r}"
            self.add(2, f"self.{self.names.python[call.module]} = PythonStep({arguments})")
        for sensor in self.sent:
            self.add(2, f"self.{self.names.last[sensor.name]} = None")
        if not attributes:
            self.add(2, "pass")
        self.blank()

    def step(self) -> None:
        self.add(1, "def step(self, t_ns, readings, taken_ns=None, restarted=False):")
        self.add(2, '"""Decisions, records and broken contracts of the frame at `t_ns`.')
        self.blank()
        self.add(
            2,
            "`readings` are in declared units; a sensor that is absent, or None, is missing. `taken_ns`",
            "has when readings were taken, by the clock of `t_ns`: one that is older than its sensor's",
            "`within` is missing. Without it readings are of now. `restarted` is true in the first frame",
            "after memory was lost.",
            '"""',
        )
        ages = f"    readings = of_age(t_ns, readings, taken_ns, {age_limits(self.code.sensors)})"
        self.add(2, "if taken_ns:", ages)
        self.add(2, "records = ()")
        if self.timed:
            self.add(2, "if self.first_ns is None:", "    self.first_ns = t_ns", "t = t_ns - self.first_ns")
        for sensor in self.code.sensors:
            self.add(2, *decision.validation_statements(sensor, self.names))
        for call, slot in self.plan.python:
            self.python(call, slot)
        for actuator in self.plan.actuators:
            self.actuator(actuator)
        self.contracts()
        self.remember_active()
        self.memory()
        self.remember_sent()
        decisions = [self.names.decision[a.actuator.actuator.name] for a in self.plan.actuators]
        listed = f"({', '.join(decisions)}{',' if len(decisions) == 1 else ''})"
        self.add(2, f"return {listed}, records, {'breaches' if self.plan.contracts else '()'}")

    def python(self, call: PythonCall, slot: int) -> None:
        self.before(slot, 2)
        arguments = []
        for read in call.reads:
            parts = [self.text(i) for i in read.elements]
            value = f"({', '.join(parts)},)" if read.array else parts[0]
            arguments.append(f"{read.name!r}: {value}")
        present, names = self.text(call.present), self.names
        values = f"{{{', '.join(arguments)}}}"
        if present != "True":
            values = f"{values} if {present} else None"
        answer = [of[call.module] for of in (names.python_active, names.python_blind, names.python_fields)]
        targets = ", ".join((*answer, "records"))
        self.add(2, f"{targets} = self.{names.python[call.module]}.step(t, {values}, records)")

    # --- actuators -------------------------------------------------------------------------------

    def actuator(self, plan: ActuatorPlan) -> None:
        """Add the chain of clients, then the decision."""
        name = plan.actuator.actuator.name
        by = self.names.by[name]
        self.blank()
        self.add(2, f"# {_comment(name)}")
        self.before(plan.slot, 2)
        if plan.may_be_blind:
            self.add(2, f"{self.names.blind[name]} = False")
        if plan.groups:
            self.add(2, "while True:")
            *_, open_end = [self.group(plan, group) for group in plan.groups]
            if open_end:
                self.add(3, f"{by} = None", "break")
        self.before(plan.after, 2)
        observed = self.code.decided < len(self.code.ops)
        decision = DecisionText(plan, self.names, self.expressions, self.ranges_of_values, observed)
        self.add(2, *decision.lines())
        self.constants += decision.constants()

    def group(self, plan: ActuatorPlan, group: GroupPlan) -> bool:
        """Add consecutive clients; return True if the code after them is reachable."""
        indent = 3
        self.before(group.slot, indent)
        if group.present is not None:
            self.add(indent, f"if {self.text(group.present)}:")
            indent += 1
        *_, always = [self.client(plan, client, indent) for client in group.clients]
        return group.present is not None or not always

    def client(self, plan: ActuatorPlan, client: ClientPlan, indent: int) -> bool:
        """Add one client; return True if its guard always holds when it is reached."""
        guard = self.text(client.client.guard)
        comment = _origin(client.client)
        self.before(client.slot, indent)
        if guard == "True":
            self.add(indent, f"# {comment}")
        else:
            self.add(indent, f"if {guard}:  # {comment}")
            indent += 1
        name = plan.actuator.actuator.name
        self.before(client.body, indent)
        self.add(indent, f"{self.names.by[name]} = {client.client.module!r}")
        known = self.expressions.text(client.client.known)
        if known.text != "True":
            self.add(indent, f"{self.names.blind[name]} = not {known.inside(Precedence.NOT)}")
        for i, value in enumerate(client.client.fields):
            self.add(indent, f"{self.names.field[name, i]} = {self.text(value)}")
        self.add(indent, "break")
        return guard == "True"

    # --- contracts and memory --------------------------------------------------------------------

    def contracts(self) -> None:
        if self.plan.contracts:
            self.blank()
            self.add(2, "# contracts", "breaches = ()")
        for contract, slot in self.plan.contracts:
            self.before(slot, 2)
            holds = self.expressions.text(contract.holds).inside(Precedence.NOT)
            self.add(2, f"if not {holds}:", f"    breaches += ({contract.name!r},)")

    def memory(self) -> None:
        if self.plan.commits:
            self.blank()
            self.add(2, "# memory")
        self.before(self.plan.memory_slot, 2)
        for commit in self.plan.commits:
            self.before(commit.slot, 2)
            condition = self.text(commit.condition)
            always = condition == "True"
            if not always:
                self.add(2, f"if {condition}:")
            indent = 2 if always else 3
            self.before(commit.body, indent)
            for cell in commit.cells:
                value = self.text(self.code.cells[cell].value)
                self.add(indent, f"self.{self.names.cells[cell]} = {value}")

    def remember_active(self) -> None:
        """Keep what is `last.MODULE is active` in the next frame, unless a reading says otherwise."""
        self.before(self.plan.activity_slot, 2)
        for name, active in self.plan.activity:
            self.add(2, f"self.{self.names.last[name]} = {self.text(active)}")

    def remember_sent(self) -> None:
        """Keep what else is `last...` in the next frame, unless a reading says otherwise."""
        idle = {plan.actuator.actuator.name: plan.actuator.actuator.idle for plan in self.plan.actuators}
        for sensor in self.sent:
            assert sensor.sent is not None
            actuator, of = sensor.sent.actuator, sensor.sent.of
            decision, last = self.names.decision[actuator], self.names.last[sensor.name]
            if isinstance(of, Role):
                if of.kind == "by":
                    self.add(2, f"self.{last} = {decision}[1] == {of.module!r}")
                continue
            keep = f"self.{last} = {decision}[2][{of}]"
            self.add(2, *([keep] if idle[actuator] is not None else [f"if {decision}[2]:", f"    {keep}"]))


def _class_name(names: UniqueNames, call: PythonCall) -> str:
    return "Python" + names.python[call.module].removeprefix("python")


def _origin(client: ClientCode) -> str:
    """Return the module, its priority and its source line, for a comment."""
    source, line = client.span.source, client.span.source.position(client.span.start)[0]
    location = "" if client.span.source.name == "<none>" else f", {source.name}:{line}"
    return _comment(f"{client.module}, priority {client.priority}{location}")


def _comment(text: str) -> str:
    return "".join(c if c.isprintable() and c not in '"\\' else "?" for c in text)


def _words(lines: list[str]) -> set[str]:
    """Return every word in the lines, to find the definitions that they need."""
    return {word for line in lines for word in re.findall(r"[A-Za-z_]\w*", line)}
