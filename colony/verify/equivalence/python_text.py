"""Formulas of the guards in generated Python or C, read from the emitted text.

The text is parsed and run symbolically, statement by statement, with a formula for "this point is reached".
Equal expressions have equal numbers; a name counts as the expression last assigned to it. `and`, `or`,
`not`, conditional expressions and constants become formulas; any other expression is an opaque condition. A
module wins when `ACTUATOR_by = 'MODULE'` is reached. C is first written as the Python that it stands for
(`c_text.py`).
"""

from __future__ import annotations

import ast
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field

from colony.compile.backends.python.generate import generate
from colony.compile.guards import ClientList
from colony.compile.lower.lower import lower
from colony.ir.program import Program
from colony.verify.equivalence.circuit import FALSE, TRUE, Circuit, Opaque
from colony.verify.equivalence.forms import (
    Form,
    Timer,
    TimerClasses,
    WinnerFormulas,
    module_of,
    with_activities,
)
from colony.verify.equivalence.json_text import EmittedFormError

PYTHON = "generated Python"

Key = tuple[object, ...]
"""An expression, by its kind and the numbers of its parts."""


Functions = Mapping[str, ast.FunctionDef]
"""The functions `__init__` and `step` of a program."""


def read_python(
    program: Program, clients: ClientList, text: str, name: str, timer_classes: TimerClasses
) -> Form:
    """Return the form that a text describes; `name` is the name of the form.

    Raises:
        EmittedFormError: the text is not what the compiler generates.
    """
    with_contracts = generate(lower(with_activities(program), clients))
    return read_functions(
        program, python_functions(text), python_functions(with_contracts), name, timer_classes
    )


def read_functions(
    program: Program, functions: Functions, with_contracts: Functions, name: str, timer_classes: TimerClasses
) -> Form:
    """Return the form of a program's functions, and of those of the program `with_activities`.

    Raises:
        EmittedFormError: the functions are not what the compiler generates.
    """
    circuit = Circuit()
    numbers: dict[Key, int] = {}
    run = _run(functions, circuit, numbers, timer_classes)
    observed = _run(with_contracts, circuit, numbers, timer_classes)
    broken = {module: observed.broken.get(name, FALSE) for name, module in _activity_contracts(program)}
    return Form(
        name=name,
        circuit=circuit,
        winners={
            actuator: tuple(
                WinnerFormulas(module=module, by_priority=reached)
                for module, reached in run.winners.get(by, {}).items()
            )
            for actuator, by in run.decided_by.items()
        },
        timers=tuple(run.timers()),
        activity={module: reached ^ 1 for module, reached in broken.items()},
    )


def _activity_contracts(program: Program) -> list[tuple[str, str]]:
    names = [contract.name for contract in with_activities(program).contracts]
    return [(name, module) for name in names if (module := module_of(name)) is not None]


def python_functions(text: str) -> Functions:
    """Return the functions of the class `Program` in a text.

    Raises:
        EmittedFormError: it is no Python, or has no such class.
    """
    try:
        tree = ast.parse(text)
    except (SyntaxError, ValueError, RecursionError) as problem:
        raise EmittedFormError(f"{type(problem).__name__}: {problem}", "Python") from None
    classes = [node for node in tree.body if isinstance(node, ast.ClassDef) and node.name == "Program"]
    functions = {n.name: n for n in classes[0].body if isinstance(n, ast.FunctionDef)} if classes else {}
    if len(classes) != 1 or not {"__init__", "step"} <= functions.keys():
        raise EmittedFormError("no class `Program` with `__init__` and `step`", "one")
    return functions


def _run(
    functions: Functions, circuit: Circuit, numbers: dict[Key, int], timer_classes: TimerClasses
) -> _Run:
    initial = {
        target.attr: statement.value.value
        for statement in functions["__init__"].body
        if isinstance(statement, ast.Assign) and isinstance(statement.value, ast.Constant)
        for target in statement.targets
        if isinstance(target, ast.Attribute)
    }
    run = _Run(circuit, numbers, timer_classes, initial, _decision_variables(functions["step"]))
    if run.block(functions["step"].body, TRUE) != FALSE:
        raise EmittedFormError("a `step` that may end without a result", "a `return` at its end")
    return run


def _decision_variables(step: ast.FunctionDef) -> Mapping[str, str]:
    """Return, for each actuator, the variable that names its winner, from the statement of its decision."""
    found: dict[str, str] = {}
    for node in ast.walk(step):
        match node:
            case ast.Call(
                func=ast.Name(id="settle"), args=[ast.Constant(value=str() as actuator), ast.Name(id=by), *_]
            ):
                pass
            case ast.Assign(
                value=ast.Tuple(elts=[ast.Constant(value=str() as actuator), ast.Name(id=by), _, _])
            ):
                pass
            case _:
                continue
        if found.setdefault(actuator, by) != by:
            raise EmittedFormError(f"decisions on {actuator} by {found[actuator]} and by {by}", "one of them")
    return found


@dataclass(slots=True)
class _Run:
    """A symbolic run of a text. Stateful: holds the values of names, and the winners reached."""

    circuit: Circuit
    numbers: dict[Key, int]
    timer_classes: TimerClasses
    initial: Mapping[str, object]
    decided_by: Mapping[str, str]
    names: dict[str, int] = field(default_factory=dict)
    winners: dict[str, dict[str, int]] = field(default_factory=dict)
    updates: dict[str, list[tuple[int, int]]] = field(default_factory=dict)
    broken: dict[str, int] = field(default_factory=dict)
    _keys: dict[int, Key] = field(default_factory=dict)
    _truths: dict[int, int] = field(default_factory=dict)
    _outer_values: dict[str, int | None] = field(default_factory=dict)  # values of names outside the block
    _loops: int = 0

    @property
    def deciders(self) -> Collection[str]:
        """The variables that name the winners."""
        return self.decided_by.values()

    # --- statements ------------------------------------------------------------------------------

    def block(self, statements: Sequence[ast.stmt], reached: int) -> int:
        """Run statements reached under a condition; return the condition under which their end is reached."""
        for position, statement in enumerate(statements):
            match statement:
                case ast.Assign(targets=[target], value=value):
                    self._assign(target, value, reached, statements[position:])
                case ast.AugAssign(value=ast.Tuple(elts=[ast.Constant(value=str() as name)])):
                    self.broken[name] = self.circuit.either(self.broken.get(name, FALSE), reached)
                case ast.If(test=test, body=body, orelse=orelse):
                    reached = self._branch(self._number(test), body, orelse, reached)
                case ast.While(test=ast.Constant(value=True), body=body, orelse=[]):
                    self._loop(body, reached)
                case ast.Break() | ast.Return():
                    return FALSE
                case ast.Expr(value=ast.Constant()):
                    pass
                case _:
                    line = f"line {statement.lineno}: {type(statement).__name__}"
                    raise EmittedFormError(line, "assignments, `if`, `while True`, `break` and `return`")
        return reached

    def _branch(self, test: int, body: Sequence[ast.stmt], orelse: Sequence[ast.stmt], reached: int) -> int:
        condition = self._truth(test)
        then_reached = self.circuit.both(reached, condition)
        else_reached = self.circuit.both(reached, condition ^ 1)
        then_end, then_names = self._scoped(body, then_reached)
        else_end, else_names = self._scoped(orelse, else_reached)
        if then_end == FALSE or else_end == FALSE:
            for name, number in (else_names if then_end == FALSE else then_names).items():
                self._bind(name, number)
            return self.circuit.either(then_end, else_end)
        for name in dict.fromkeys((*then_names, *else_names)):
            outside = self.names.get(name)
            before = self._numbered(("undefined", name)) if outside is None else outside
            parts = (then_names.get(name, before), else_names.get(name, before))
            self._bind(name, self._numbered(("IfExp", test, *parts)))
        if then_end == then_reached and else_end == else_reached:
            return reached
        return self.circuit.either(then_end, else_end)

    def _loop(self, body: Sequence[ast.stmt], reached: int) -> None:
        """Run a loop once: every branch that is reached ends with a `break`."""
        end, changed = self._scoped(body, reached)
        if end != FALSE:
            raise EmittedFormError("a loop over clients that may not end", "a `break` after every client")
        self._loops += 1
        for name in (*changed, *self.decided_by.values()):
            self._bind(name, self._numbered(("after loop", self._loops, name)))

    def _scoped(self, statements: Sequence[ast.stmt], reached: int) -> tuple[int, Mapping[str, int]]:
        """Run statements in their own scope; return the condition for reaching the end, and changed names."""
        outer, self._outer_values = self._outer_values, {}
        end = self.block(statements, reached)
        changed = {name: self.names[name] for name in self._outer_values}
        for name, number in self._outer_values.items():
            if number is None:
                del self.names[name]
            else:
                self.names[name] = number
        self._outer_values = outer
        return end, changed

    def _bind(self, name: str, number: int) -> None:
        self._outer_values.setdefault(name, self.names.get(name))
        self.names[name] = number

    def _assign(self, target: ast.expr, value: ast.expr, reached: int, rest: Sequence[ast.stmt]) -> None:
        number = self._number(value)
        match target:
            case ast.Name(id=name):
                self._bind(name, number)
                if name in self.deciders:
                    self._record_winner(name, value, reached, rest)
            case ast.Tuple(elts=elements):
                for i, element in enumerate(elements):
                    if isinstance(element, ast.Name):
                        self._bind(element.id, self._numbered(("item", number, i)))
            case ast.Attribute(value=ast.Name(id="self"), attr=attribute):
                self.updates.setdefault(attribute, []).append((reached, number))
            case _:
                raise EmittedFormError(
                    f"line {target.lineno}: {ast.unparse(target)} = ...", "a name or attribute"
                )

    def _record_winner(self, by: str, value: ast.expr, reached: int, rest: Sequence[ast.stmt]) -> None:
        """Record a winner, and check that it is final: a `break` must follow before any other winner."""
        match value:
            case ast.Constant(value=None):
                return
            case ast.Constant(value=str() as module):
                pass
            case _:
                raise EmittedFormError(
                    f"line {value.lineno}: {by} = {ast.unparse(value)}", "the name of a module"
                )
        straight = all(isinstance(s, ast.Assign) for s in rest[:-1]) and isinstance(rest[-1], ast.Break)
        others = [s for s in rest[1:-1] if isinstance(s, ast.Assign) and _mentions(s.targets[0], by)]
        if not straight or others:
            raise EmittedFormError(f"line {value.lineno}: {by} = {module!r}", "a `break` right after it")
        winners = self.winners.setdefault(by, {})
        winners[module] = self.circuit.either(winners.get(module, FALSE), reached)

    # --- expressions -----------------------------------------------------------------------------

    def _number(self, node: ast.expr) -> int:
        """Return the number of an expression at this point of the run."""
        match node:
            case ast.Name(id=name):
                known = self.names.get(name)
                return self._numbered(("name", name)) if known is None else known
            case ast.Attribute(value=ast.Name(id="self"), attr=attribute):
                return self._numbered(("cell", attribute, len(self.updates.get(attribute, ()))))
            case ast.Constant(value=value):
                return self._numbered(("constant", type(value).__name__, repr(value)))
            case ast.BoolOp(op=op, values=values):
                return self._numbered((type(op).__name__, *(self._number(v) for v in values)))
            case ast.UnaryOp(op=ast.Not(), operand=operand):
                return self._numbered(("Not", self._number(operand)))
            case ast.IfExp(test=test, body=body, orelse=orelse):
                parts = (self._number(part) for part in (test, body, orelse))
                return self._numbered(("IfExp", *parts))
            case _:
                return self._numbered((type(node).__name__, *self._parts(node)))

    def _parts(self, node: ast.AST) -> list[object]:
        parts: list[object] = []
        for _, value in ast.iter_fields(node):
            items = value if isinstance(value, list) else [value]
            for item in items:
                match item:
                    case ast.expr():
                        parts.append(self._number(item))
                    case ast.AST():
                        parts.append((type(item).__name__, *self._parts(item)))
                    case _:
                        parts.append(repr(item))
            parts.append(len(items))
        return parts

    def _numbered(self, key: Key) -> int:
        number = self.numbers.setdefault(key, len(self.numbers))
        if number not in self._keys:
            self._keys[number] = key
            if key[0] in ("And", "Or", "Not", "IfExp"):
                self._truth(number)  # eagerly, so that long chains of names cause no deep recursion
        return number

    def _truth(self, number: int) -> int:
        """Return the formula for "the expression is true"."""
        known = self._truths.get(number)
        if known is None:
            known = self._truths[number] = self._formula(number, self._keys[number])
        return known

    def _formula(self, number: int, key: Key) -> int:
        circuit = self.circuit
        match key:
            case ("constant", "bool", value):
                return TRUE if value == "True" else FALSE
            case ("And", *parts):
                return circuit.all([self._truth(_int(part)) for part in parts])
            case ("Or", *parts):
                return circuit.any([self._truth(_int(part)) for part in parts])
            case ("Not", int(operand)):
                return self._truth(operand) ^ 1
            case ("IfExp", int(test), int(yes), int(no)):
                return circuit.choice(self._truth(test), self._truth(yes), self._truth(no))
            case ("Compare", int(now), _, ("Lt",), _, int(end), _) if now == self.names.get("t"):
                cell = self._keys[end]
                if cell[0] == "cell" and cell[2] == 0:
                    return self._history(str(cell[1]))
            case _:
                pass
        return circuit.input(Opaque(f"expression {number}"))

    def _history(self, cell: str) -> int:
        same = self.timer_classes.get(cell, cell)
        return FALSE if same is None else self.circuit.input(Opaque(f"t < self.{same}"))

    def timers(self) -> list[Timer]:
        """Return the attributes that hold the end of a time constant: initially 0, then a window after t."""
        found = []
        for cell, updates in self.updates.items():
            (reached, number), *further = updates
            initial = self.initial.get(cell)
            if further or type(initial) is not int or initial != 0:
                continue
            window_ns = self._window(self._keys[number])
            if window_ns is not None:
                history = self._history(cell)
                found.append(Timer(cell=cell, operand=reached, window_ns=window_ns, history=history))
        return found

    def _window(self, key: Key) -> int | None:
        """Return the n of an expression `t + n`."""
        match key:
            case ("BinOp", int(now), _, ("Add",), _, int(window), _) if now == self.names.get("t"):
                kind, *value = self._keys[window]
                return int(str(value[1])) if kind == "constant" and value[0] == "int" else None
            case _:
                return None


def _int(part: object) -> int:
    assert isinstance(part, int)
    return part


def _mentions(target: ast.expr, name: str) -> bool:
    return any(isinstance(node, ast.Name) and node.id == name for node in ast.walk(target))
