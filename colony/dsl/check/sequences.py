"""Sequences: tasks in order, written out as a machine, derived values, modules and wires.

`sequence deliver` becomes the machine `deliver`, a module `deliver.TASK` for each task and a wire
`deliver.ACTUATOR` for each actuator that tasks command, all of them declarations of the syntax tree. Names
with a dot cannot be written in a declaration, so nothing else has them. `deliver.called`, `deliver.held` and
`deliver.time` are lets, `deliver.frames` is a state. No later stage knows sequences.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

from colony.dsl import ast
from colony.dsl.check.checker import Checker
from colony.dsl.check.compatibility import constant_value
from colony.dsl.check.declare import ModuleNode, references_in, text_of
from colony.dsl.check.expressions import ExpressionChecker
from colony.dsl.check.scope import (
    BrokenSymbol,
    CheckReport,
    FileScope,
    ModuleSymbol,
    SequenceSymbol,
    WireSymbol,
)
from colony.dsl.files import ParsedFile
from colony.ir import expression as ir
from colony.ir import program as program_ir
from colony.text.diagnostics import Diagnostic, warning
from colony.text.wording import quoted

WAITING, DONE = "waiting", "done"
"""The phases of a sequence before its first task and after its last one."""

Modules = Mapping[str, tuple[FileScope, ModuleNode]]
"""The declarations of all modules of a program, by full name."""


def with_modules_of_tasks(file: ParsedFile) -> ParsedFile:
    """Return a file with the module of each task after its sequence."""
    declarations: list[ast.Declaration] = []
    for node in file.tree.declarations:
        declarations.append(node)
        if isinstance(node, ast.SequenceDecl):
            declarations += [_module(node, task) for task in node.tasks]
    return replace(file, tree=replace(file.tree, declarations=tuple(declarations)))


def _module(node: ast.SequenceDecl, task: ast.TaskDecl) -> ast.DerivedModuleDecl:
    """Return the module of a task, which applies only in its phase."""
    return ast.DerivedModuleDecl(
        name=_named(f"{node.name.text}.{task.name.text}", task.name),
        failsafe=False,
        base=task.base,
        arguments=task.arguments,
        phase=_in_phase(node, task),
        start=task.start,
        end=task.end,
    )


def write_out_sequences(report: CheckReport, scopes: Sequence[FileScope], modules: Modules) -> None:
    """Add what sequences stand for to the declarations of their files, and report sequences that are wrong.

    The constants and the robot are checked.
    """
    for scope in scopes:
        checker = ExpressionChecker(scope=scope, report=report)
        added: list[ast.Declaration] = []
        declarations = _with_valid_sequences(scope)
        bases = {t.base.text for d in declarations if isinstance(d, ast.SequenceDecl) for t in d.tasks}
        for node in declarations:
            if isinstance(node, ast.SequenceDecl):
                _check_names(checker, node)
                _check_failures(checker, node, scopes)
                writer = _SequenceWriter(checker, node, modules)
                added += writer.declarations()
                if None in writer.commands.values():  # which is reported: a wire may lack for that reason
                    for actuator in scope.robot.actuator_names:
                        name = f"{node.name.text}.{actuator}"
                        is_base = name in bases  # a wire, which is reported there
                        symbol = WireSymbol(name=scope.full_name(name)) if is_base else BrokenSymbol()
                        scope.network_symbols.setdefault(name, symbol)
        for declaration in added:
            if isinstance(declaration, ast.NetworkDecl):
                for wire in declaration.wires:
                    name = wire.name.text
                    scope.network_symbols[name] = WireSymbol(name=scope.full_name(name))
            elif isinstance(declaration, ast.LetDecl | ast.StateDecl):
                scope.visible_values[declaration.name.text] = scope
        tree = replace(scope.file.tree, declarations=(*declarations, *added))
        scope.file = replace(scope.file, tree=tree)  # at the end, below all that their conditions may read


def _with_valid_sequences(scope: FileScope) -> list[ast.Declaration]:
    """Return the declarations of a file without sequences with names of others, which were reported."""
    declarations: list[ast.Declaration] = []
    names, invalid = set[str](), set[str]()
    for node in scope.file.tree.declarations:
        if isinstance(node, ast.SequenceDecl):
            name = node.name.text
            is_part = isinstance(scope.network_symbols.get(name), SequenceSymbol)
            is_value = scope.visible_values.get(name) is scope and name not in scope.values
            if not is_part or not is_value or name in names:
                invalid.add(name)
                scope.values.setdefault(name, BrokenSymbol())
                continue
            names.add(name)
        is_task = isinstance(node, ast.DerivedModuleDecl) and node.phase is not None
        if not (is_task and node.name.text.partition(".")[0] in invalid):  # type: ignore[union-attr]
            declarations.append(node)
    return declarations


def bases_of_tasks(scope: FileScope) -> set[str]:
    """Return the full names of the modules that the tasks of a file are derived from."""
    found = set[str]()
    for node in scope.file.tree.declarations:
        for task in node.tasks if isinstance(node, ast.SequenceDecl) else ():
            inner, path = scope.resolve_part(task.base.path)
            symbol = inner.network_symbol(path[0])
            found |= {symbol.name} if isinstance(symbol, ModuleSymbol) else set()
    return found


# --- checks ------------------------------------------------------------------------------------------


def _check_names(checker: Checker, node: ast.SequenceDecl) -> None:
    reserved = {
        WAITING: "the phase before the first task",
        DONE: "the phase after the last task",
        node.name.text: "the sequence itself",
        **dict.fromkeys(checker.scope.robot.actuator_names, "an actuator, and its wire here"),
    }
    for task in node.tasks:
        meaning = reserved.get(task.name.text)
        if meaning is not None:
            message = f"a task cannot be named `{task.name.text}`, which is {meaning}"
            checker.error("E407", task.name, message, f"name it: `NAME = {task.base.text} until ...`")
        if task.otherwise is not None and task.otherwise.text == WAITING:
            hint = f"name a task, such as `{node.tasks[0].name.text}`, or an end, such as `failed`"
            checker.error("E407", task.otherwise, f"nothing goes back to `{WAITING}` by `else`", hint)


def _failures(node: ast.SequenceDecl) -> dict[str, ast.NameNode]:
    """Return the ends that `else` names, each where it is first named."""
    tasks = {task.name.text for task in node.tasks}
    ends: dict[str, ast.NameNode] = {}
    for task in node.tasks:
        if task.otherwise is not None and task.otherwise.text not in tasks | {WAITING, DONE}:
            ends.setdefault(task.otherwise.text, task.otherwise)
    return ends


def _check_failures(checker: Checker, node: ast.SequenceDecl, scopes: Sequence[FileScope]) -> None:
    """Report each failure that nothing reads: the robot would stand there, and nothing would notice."""
    failures = _failures(node)
    if not failures or any(scope.incomplete or scope.file.lost_names for scope in scopes):
        return
    read = set[str]()
    for scope in scopes:
        for declaration in scope.file.tree.declarations:
            if declaration is node or isinstance(declaration, ast.TestDecl):
                continue
            if isinstance(declaration, ast.ContractDecl) and declaration.reach:
                continue
            for reference in references_in(declaration):
                inner, path = scope.resolve(reference.path)
                if inner.visible_values.get(path[0]) is checker.scope and path[0] == node.name.text:
                    is_whole = len(path) == 1 and isinstance(declaration, ast.PythonModuleDecl)
                    read |= set(failures) if is_whole else set(path[1:2])
    for name, place in failures.items():
        if name not in read:
            phase = f"{node.name.text}.{name}"
            message = f"nothing reads the failure `{phase}`, so it would be forgotten"
            hint = f"react to it, for example `module NAME {{ when {node.name.text} == {phase} do ... }}`"
            checker.error("E410", place, message, hint)


# --- writing out -------------------------------------------------------------------------------------


class _SequenceWriter:
    """Writes out one sequence. Conditions stand at their task, so errors point at it."""

    def __init__(self, checker: Checker, node: ast.SequenceDecl, modules: Modules) -> None:
        self.checker = checker
        self.node = node
        self.name = node.name.text
        self.commands = {task.name.text: _actuator(checker, node, task, modules) for task in node.tasks}
        limits = {task.name.text: self._frames(task) for task in node.tasks if task.within is not None}
        self.limits = {task.name.text: limits[task.name.text] for task in node.tasks if _times_out(task)}

    def declarations(self) -> Iterator[ast.Declaration]:
        """Yield what the sequence stands for."""
        node, limits = self.node, [n for n in self.limits.values() if n is not None]
        if node.when is not None:
            yield self._let("called", node.when)
        if limits or node.restarts:
            held = [held for task in node.tasks if (held := self._held_in(task)) is not None]
            yield self._let("held", _joined("or", held) or ast.Boolean(value=False, **_place(node.name)))
        if limits:
            yield self._let("time", self._time())
            yield ast.StateDecl(
                name=self._own("frames"), type=None, initial=_number(0, node.name), **_place(node.name)
            )
            frames = self._next_frames(max(limits))
            yield ast.NextDecl(name=self._own("frames"), value=frames, **_place(node.name))
        yield self._machine()
        wires = [self._wire(actuator) for actuator in dict.fromkeys(self.commands.values()) if actuator]
        yield ast.NetworkDecl(wires=tuple(wires), **_place(node.name))

    def _machine(self) -> ast.MachineDecl:
        node, tasks = self.node, self.node.tasks
        transitions: list[ast.TransitionDecl] = []
        start = tasks[0].name
        if node.when is not None:
            start = _named(WAITING, node.name)
            transitions.append(_transition(start, tasks[0].name, self._read("called"), node.when))
        followers = [*(task.name for task in tasks[1:]), _named(DONE, node.name)]
        for task, follower in zip(tasks, followers, strict=True):
            transitions += self._transitions(task, follower)
        if node.when is not None:
            over = ast.Prefix(operator="not", operand=self._read("called"), depth=2, **_place(node.when))
            ends = [_named(DONE, node.name), *_failures(node).values()]
            transitions += [_transition(end, start, over, node.when) for end in ends]
        return ast.MachineDecl(
            name=node.name,
            initial=start,
            transitions=tuple(transitions),
            tasks=tuple(task.name for task in tasks),
            **_place(node),
        )

    def _transitions(self, task: ast.TaskDecl, follower: ast.NameNode) -> Iterator[ast.TransitionDecl]:
        node, first = self.node, self.node.tasks[0]
        if node.restarts and task is not first:
            yield _transition(task.name, first.name, self._read("held"), task.name)
        ending = _transition(task.name, follower, task.until, task.until)
        yield replace(ending, through=self._through(task))
        if not _times_out(task) and self._is_constantly_false(task.until):
            message = f"the task `{task.name.text}` can neither end nor time out"
            hint = "correct its `until`, or give it a time: `within 10 s else PHASE`"
            self.checker.error("E409", task.until, message, hint)
        limit = self.limits.get(task.name.text)
        if limit is not None and task.otherwise is not None and task.within is not None:
            due = self._is_due(task, limit)
            yield _transition(task.name, task.otherwise, due, task.within, failsafe=True)

    def _is_constantly_false(self, node: ast.Expression) -> bool:
        quiet = replace(self.checker, report=CheckReport(), memory=False, constants_only=True)
        found = quiet.check(node)
        return found is not None and constant_value(found) is False

    def _frames(self, task: ast.TaskDecl) -> int | None:
        """Return the time limit of a task in frames, rounded up, or None after reporting an error."""
        assert task.within is not None
        limit_ns = self.checker.duration_ns(task.within, "the time limit of a task")
        frame_ns = self.checker.scope.robot.frame_ns
        if limit_ns == 0:
            hint = "give the task time, or leave out `within`"
            self.checker.error("E412", task.within, "the time limit of a task must be longer than 0", hint)
            return None
        return None if limit_ns is None or not frame_ns else -(-limit_ns // frame_ns)

    def _is_due(self, task: ast.TaskDecl, limit: int) -> ast.Expression:
        """Return the condition that a task, which is not held, was in its phase for `limit` frames."""
        assert task.within is not None
        late = _infix(">=", self._read("time"), _number(limit, task.within), task.within)
        held = ast.Prefix(operator="not", operand=self._read("held"), depth=2, **_place(task.within))
        return _infix("and", late, held, task.within)

    def _time(self) -> ast.Expression:
        """Return the frames in the present phase before this one, without those in which it was held."""
        name = self.node.name
        changed = ast.CallNode(
            function=_named("changed", name),
            arguments=(_reference(name, self.name),),
            named=(),
            depth=2,
            **_place(name),
        )
        return _if(changed, _number(0, name), self._read("frames"))

    def _next_frames(self, limit: int) -> ast.Expression:
        """Return the next number of frames, which is at most `limit`."""
        node, name = self.node, self.node.name
        more = _infix("+", self._read("time"), _number(1, name), name)
        arguments = (more, _number(limit, name))
        count: ast.Expression = ast.CallNode(
            function=_named("min", name), arguments=arguments, named=(), depth=3, **_place(name)
        )
        return _if(self._read("held"), _number(0, name) if node.restarts else self._read("time"), count)

    def _through(self, task: ast.TaskDecl) -> ast.Expression | None:
        """Return whether the module of a task got through in the frame before."""
        actuator = self.commands[task.name.text]
        if actuator is None:
            return None
        last = _reference(task.name, program_ir.SENT, actuator)
        module = _reference(task.name, f"{self.name}.{task.name.text}")
        return ast.By(actuator=last, module=module, depth=2, **_place(task.name))

    def _held_in(self, task: ast.TaskDecl) -> ast.Expression | None:
        """Return whether a task is present, and its module did not get through in the frame before."""
        through = self._through(task)
        if through is None:
            return None
        last = _reference(task.name, program_ir.SENT, f"{self.name}.{task.name.text}")
        active = ast.Is(subject=last, status="active", depth=2, **_place(task.name))
        kept_out = ast.Prefix(operator="not", operand=through, depth=3, **_place(task.name))
        held = _infix("and", active, kept_out, task.name)
        return _infix("and", _in_phase(self.node, task), held, task.name)

    def _wire(self, actuator: str) -> ast.WireDecl:
        """Return the wire of an actuator: the modules of the tasks that command it."""
        node = self.node
        modules = [
            _reference(task.name, f"{self.name}.{task.name.text}")
            for task in node.tasks
            if self.commands[task.name.text] == actuator
        ]
        links = [ast.LinkNode(relation="suppresses", window=None, **_place(m)) for m in modules[1:]]
        chain = ast.ChainNode(operands=tuple(modules), links=tuple(links), **_place(node.name))
        wiring = chain if links else modules[0]
        return ast.WireDecl(name=self._own(actuator), wiring=wiring, **_place(node.name))

    def _own(self, name: str) -> ast.NameNode:
        return _named(f"{self.name}.{name}", self.node.name)

    def _read(self, name: str) -> ast.Reference:
        return _reference(self.node.name, f"{self.name}.{name}")

    def _let(self, name: str, value: ast.Expression) -> ast.LetDecl:
        return ast.LetDecl(name=self._own(name), value=value, **_place(self.node.name))


def _times_out(task: ast.TaskDecl) -> bool:
    """Return True if a task is left after a time; one that is followed by itself is not."""
    return task.otherwise is not None and task.otherwise.text != task.name.text


def _actuator(checker: Checker, node: ast.SequenceDecl, task: ast.TaskDecl, modules: Modules) -> str | None:
    """Return the actuator that the module of a task commands, or None after reporting that it does not fit.

    What is unknown is reported where modules are checked.
    """
    name = f"{node.name.text}.{task.name.text}"
    found = modules.get(checker.scope.full_name(name))
    if found is None:
        return None
    _, text, is_failsafe = text_of(*found, modules)
    phase = f"{node.name.text} == {name}"
    if isinstance(text, ast.PythonModuleDecl):
        message = f"`{task.base.text}` is a module in Python, and cannot be a task"
        hint = f"let it read `{node.name.text}` and answer `None` in other phases, and wire it"
        checker.error("E411", task.base, message, hint)
    elif text is not None and text.do is None:
        message = f"`{task.base.text}` commands nothing, and cannot be a task"
        checker.error("E411", task.base, message, "give it a command: `do ACTUATOR(...)`")
    elif is_failsafe:
        message = (
            f"`{task.base.text}` is failsafe, and cannot be a task: it would be blind in other phases, too"
        )
        hint = f"derive the task from an ordinary module, and let a failsafe one with `{phase}` suppress it"
        checker.error("E411", task.base, message, hint)
    elif text is not None and text.do is not None:
        actuator = text.do.actuator.text
        return actuator if actuator in checker.scope.robot.actuator_names else None
    return None


# --- nodes -------------------------------------------------------------------------------------------
#
# Nodes of the tree that stand at the place of another node.


def _place(node: ast.SyntaxNode) -> dict[str, int]:
    return {"start": node.start, "end": node.end}


def _named(text: str, node: ast.SyntaxNode) -> ast.NameNode:
    return ast.NameNode(text=text, **_place(node))


def _reference(node: ast.SyntaxNode, *path: str) -> ast.Reference:
    return ast.Reference(path=path, start=node.start, end=node.end)


def _number(value: int, node: ast.SyntaxNode) -> ast.NumberNode:
    return ast.NumberNode(digits=str(value), unit=None, start=node.start, end=node.end)


def _infix(
    operator: str, left: ast.Expression, right: ast.Expression, node: ast.SyntaxNode
) -> ast.Expression:
    depth = 1 + max(left.depth, right.depth)
    return ast.Infix(operator=operator, left=left, right=right, depth=depth, start=node.start, end=node.end)


def _if(condition: ast.Expression, yes: ast.Expression, no: ast.Expression) -> ast.Expression:
    depth = 1 + max(condition.depth, yes.depth, no.depth)
    return ast.If(condition=condition, yes=yes, no=no, depth=depth, start=condition.start, end=condition.end)


def _joined(operator: str, parts: Sequence[ast.Expression]) -> ast.Expression | None:
    """Return parts joined by an operator, nested as little as can be; None without parts."""
    if len(parts) < 2:
        return parts[0] if parts else None
    half = len(parts) // 2
    left, right = _joined(operator, parts[:half]), _joined(operator, parts[half:])
    assert left is not None
    assert right is not None
    return _infix(operator, left, right, left)


def _in_phase(node: ast.SequenceDecl, task: ast.TaskDecl) -> ast.Expression:
    present = _reference(task.name, node.name.text)
    return _infix("==", present, _reference(task.name, node.name.text, task.name.text), task.name)


def _transition(
    source: ast.NameNode,
    target: ast.NameNode,
    condition: ast.Expression,
    node: ast.SyntaxNode,
    *,
    failsafe: bool = False,
) -> ast.TransitionDecl:
    return ast.TransitionDecl(
        failsafe=failsafe,
        source=source,
        target=target,
        condition=condition,
        start=node.start,
        end=node.end,
    )


# --- waiting for ever --------------------------------------------------------------------------------


def waiting_findings(
    checker: Checker,
    node: ast.SequenceDecl,
    derived: Sequence[program_ir.Derived],
    sensors: Mapping[str, program_ir.Sensor],
) -> Iterator[Diagnostic]:
    """Yield a warning for each task without a time limit that ends by a sensor that can be missing."""
    lets = {d.name: d.expression for d in derived if isinstance(d, program_ir.Let)}
    name = checker.scope.full_name(node.name.text)
    machine = next(d for d in derived if isinstance(d, program_ir.Machine) and d.name == name)
    numbers = dict(machine.type.members)
    for task in node.tasks:
        span = checker.span(task.until)
        conditions = [
            t.condition
            for t in machine.transitions
            if t.sources == {numbers[task.name.text]} and t.span == span and not t.failsafe
        ]
        if not _times_out(task):
            missing = [
                sensor
                for sensor in _sensors_needed(conditions, lets)
                if sensor in sensors and sensors[sensor].default is None
            ]
            if missing:
                message = f"the task `{task.name.text}` waits for ever if {quoted(missing)} stays missing"
                hint = "give it a time, `within 30 s else PHASE`, or a value for then: `value_or(..., false)`"
                yield warning("W015", span, message, hint)


def _sensors_needed(expressions: Sequence[ir.Expression], lets: Mapping[str, ir.Expression]) -> list[str]:
    """Return the sensors without which expressions are missing, in order, also by way of lets."""
    found: dict[str, None] = {}
    seen, work = set[str](), list(expressions)
    while work:
        match work.pop():
            case ir.SensorValue(name=name):
                found[name] = None
            case ir.DerivedValue(name=name):
                if name not in seen and name in lets:
                    seen.add(name)
                    work.append(lets[name])
            case ir.Fresh():
                pass
            case ir.ValueOr(other=other):
                work.append(other)
            case expression:
                work += reversed(ir.children(expression))
    return list(found)
