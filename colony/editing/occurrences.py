"""Every use of each declaration of a program, found by the front end's own scopes.

Each expression, wiring and test is walked with the names that are local to it. A name that nothing declares
has no use: the front end reports it.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import fields
from functools import cache

from colony.dsl import ast
from colony.dsl.check.scope import FileScope
from colony.dsl.files import ParsedFile
from colony.editing.declarations import DeclarationTable
from colony.ir.expression import NESTING_LIMIT
from colony.ir.program import SENT

Local = Mapping[str, int]
"""The declarations that an expression can name before all others: those of its module or function."""

_WORD = re.compile(r"[A-Za-z_]\w*")


@cache
def _parts_of(kind: type) -> tuple[str, ...]:
    """Return the fields of a node that may hold nodes."""
    names = (f.name for f in fields(kind))
    return tuple(name for name in names if name not in ("start", "end", "depth"))


class Occurrences(DeclarationTable):
    """The declarations and uses of a program. Filled in by `find`, then only read."""

    def find(self) -> None:
        """Find all declarations, then all uses."""
        self.declare_all()
        for number, base, reference in self.bases:
            self._begin(base, self.tree.files[base])
            found = self._resolved(reference.path, {}, prefers_parts=True)
            if len(found) == len(reference.path) and found[-1] is not None and found[-1] != number:
                self._derive(number, found[-1])
        for number, file in enumerate(self.tree.files):
            self._begin(number, file)
            self._uses_of_imports(file)
            for node in file.tree.declarations:
                self._visit_declaration(node)
        for uses in self.uses:
            uses[:] = sorted(set(uses))

    # --- names

    def _resolved(
        self, path: Sequence[str], local: Local, *, prefers_parts: bool = False
    ) -> list[int | None]:
        """Return the declaration of each component of a path, as far as they are known."""
        if path[0] == SENT and path[0] not in local:
            return (
                [None, *self._members_of(self._part(self._scope, path[1]), path[1:])] if len(path) > 1 else []
            )
        if path[0] in local:
            return self._members_of(local[path[0]], path)
        found: list[int | None] = []
        scope = self._scope
        while len(path) > 1 and path[0] in scope.aliases:
            found.append(self._alias(scope, path[0]))
            scope, path = scope.aliases[path[0]], path[1:]
        value, part = self._value(scope, path[0]), self._part(scope, path[0])
        both = [self._members_of(start, path) for start in (value, part)]
        if prefers_parts:
            both.reverse()
        return [*found, *max(both, key=len)]

    def _members_of(self, start: int | None, path: Sequence[str]) -> list[int | None]:
        found: list[int | None] = []
        for name in path[1:]:
            if start is None:
                return found
            found.append(start)
            start = self.member(start, name)
        return found if start is None else [*found, start]

    @property
    def _scope(self) -> FileScope:
        return self.scopes[self.tree.files[self._file].key]

    def _value(self, scope: FileScope, name: str) -> int | None:
        owner = scope.visible_values.get(name)
        if owner is not None:
            return self.values[self.numbers[owner.file.key]].get(name)
        found = self.robot.get(name)
        return found if found is not None and self.declarations[found].kind == "sensor" else None

    def _part(self, scope: FileScope, name: str) -> int | None:
        owner = scope.visible_network_symbols.get(name)
        if owner is not None:
            return self.parts[self.numbers[owner.file.key]].get(name)
        found = self.robot.get(name)
        return found if found is not None and self.declarations[found].kind == "actuator" else None

    def _alias(self, scope: FileScope, name: str) -> int | None:
        """Return the alias that a scope declares, or imports from a file without an alias."""
        seen, work = set[str](), [scope.file]
        while work:
            file = work.pop()
            number = self.numbers[file.key]
            if name in self.aliases[number]:
                return self.aliases[number][name]
            seen.add(file.key)
            plain = (i.target for i in self.tree.files[number].imports if i.declaration.alias is None)
            work += [
                self.tree.files[self.numbers[key]] for key in plain if key in self.numbers and key not in seen
            ]
        return None

    def _use(self, start: int, end: int, declarations: Sequence[int | None]) -> None:
        """Record the uses in a dotted name."""
        words = _WORD.finditer(self._text, start, end)
        for word, number in zip(words, declarations, strict=False):
            if number is not None:
                self.uses[self._file].append((*word.span(), number))

    def _use_member(self, name: ast.NameNode, owner: int | None) -> None:
        found = None if owner is None else self.member(owner, name.text)
        self._use(name.start, name.end, [found])

    def _use_part(self, name: ast.NameNode) -> int | None:
        """Record the use of a part of the network; return its declaration."""
        found = self._part(self._scope, name.text)
        self._use(name.start, name.end, [found])
        return found

    # --- walk

    def _uses_of_imports(self, file: ParsedFile) -> None:
        for import_ in file.imports:
            target = self.numbers.get(import_.target)
            if target is not None:
                node = import_.declaration
                start = self._text.find('"', node.start, node.end)
                if isinstance(node, ast.RobotImportDecl):
                    place = (self._text.rfind("robot", node.start, node.end), node.end)
                else:
                    place = (start + 1, self._text.find('"', start + 1))
                self.uses[self._file].append((*place, target))  # the first declarations are the files

    def _visit_declaration(self, node: ast.Declaration) -> None:
        match node:
            case ast.ModuleDecl():
                self._visit_module(node)
            case ast.PythonModuleDecl(clauses=clauses):
                self._visit(clauses, {})
            case ast.DerivedModuleDecl(base=base, arguments=arguments):
                self._visit_derived(base, arguments)
            case ast.SequenceDecl():
                self._visit(node.when, {})
                for task in node.tasks:
                    self._visit_derived(task.base, task.arguments)
                    self._visit((task.until, task.within), {})
                    if task.otherwise is not None:
                        self._use_member(task.otherwise, self.values[self._file].get(node.name.text))
            case ast.NetworkDecl(wires=wires):
                for wire in wires:
                    self._use_part(wire.name)
                    self._visit_wiring(wire.wiring)
            case ast.NextDecl():
                self._use(node.name.start, node.name.end, [self.values[self._file].get(node.name.text)])
                self._visit(node.value, {})
            case _:
                self._visit(node, {})

    def _visit_module(self, node: ast.ModuleDecl) -> None:
        """Walk a module; a `let` of it sees those above it alone."""
        number = self.parts[self._file].get(node.name.text)
        members = self.members.get(-1 if number is None else number, {})
        late = (ast.LetDecl, ast.FunctionDecl)
        local = {
            c.name.text: members[c.name.text]
            for c in node.clauses
            if c.name.text in members and not isinstance(c, late)
        }
        for clause in node.clauses:
            if isinstance(clause, ast.NextDecl):
                self._use(clause.name.start, clause.name.end, [members.get(clause.name.text)])
                self._visit(clause.value, local)
                continue
            self._visit(clause, local)
            if isinstance(clause, late) and clause.name.text in members:
                local = {**local, clause.name.text: members[clause.name.text]}
        self._visit(node.when, local)
        if node.do is not None:
            self._visit_command(node.do.actuator, node.do.arguments, local)

    def _visit_command(self, actuator: ast.NameNode, arguments: Sequence[ast.Argument], local: Local) -> None:
        owner = self._use_part(actuator)
        for argument in arguments:
            self._use_member(argument.name, owner)
            self._visit(argument.value, local)

    def _visit_derived(self, base: ast.Reference, arguments: Sequence[ast.Argument]) -> None:
        found = self._resolved(base.path, {}, prefers_parts=True)
        self._use(base.start, base.end, found)
        for argument in arguments:
            self._use_member(argument.name, found[-1] if len(found) == len(base.path) else None)
            self._visit(argument.value, {})

    def _visit_wiring(self, wiring: ast.Wiring) -> None:
        work: list[ast.Wiring] = [wiring]
        while work:
            part = work.pop()
            if isinstance(part, ast.Reference):
                self._use(part.start, part.end, self._resolved(part.path, {}, prefers_parts=True))
            else:
                work += part.operands
                self._visit(tuple(link.window for link in part.links), {})

    def _visit(self, node: object, local: Local) -> None:
        """Walk a node with the names that are local to it."""
        match node:
            case tuple():
                for part in node:
                    self._visit(part, local)
            case ast.ExpressionNode(depth=depth) if depth > NESTING_LIMIT:
                return
            case ast.Reference(path=path):
                self._use(node.start, node.end, self._resolved(path, local))
            case ast.By(actuator=actuator, module=module):
                self._visit_part(actuator)
                self._visit_part(module)
            case ast.Is(subject=subject):
                self._visit_part(subject)
            case ast.CallNode():
                self._visit_call(node, local)
            case ast.Comprehension(variable=variable):
                self._visit((node.low, node.high), local)
                self._visit_reduction((variable,), (node.body, node.condition), node, local)
            case ast.ElementsComprehension(variable=variable, bearing=bearing):
                self._visit(node.array, local)
                names = (variable,) if bearing is None else (variable, bearing)
                self._visit_reduction(names, (node.body, node.condition), node, local)
            case ast.SyntaxNode():
                self._visit_clause(node, local)
            case _:
                pass

    def _visit_clause(self, node: ast.SyntaxNode, local: Local) -> None:
        """Walk a node that is no expression."""
        match node:
            case ast.FunctionDecl(parameters=parameters):
                self._visit(parameters, local)
                own = self.members.get(self.declared.get((self._file, node.name.start), -1), {})
                self._visit(node.value, {**local, **own})
            case ast.TypeName(path=path):
                self._use(node.start, node.end, self._resolved(path, {}))
            case ast.LimitDecl(actuator=actuator, field=field):
                self._use_member(field, self._use_part(actuator))
                self._visit((node.bound, node.condition), local)
            case ast.CommandsDecl(actuator=actuator):
                self._use_part(actuator)
            case ast.IdleDecl(name=name, arguments=arguments) if arguments is not None:
                self._visit_command(name, arguments, local)
            case ast.MachineDecl(initial=initial, transitions=transitions):
                machine = self.values[self._file].get(node.name.text)
                self._use_member(initial, machine)
                for transition in transitions:
                    for phase in (transition.source, transition.target):
                        if phase is not None:
                            self._use_member(phase, machine)
                    self._visit(transition.condition, local)
            case _:
                for part in _parts_of(type(node)):  # type: ignore[arg-type]
                    self._visit(getattr(node, part), local)

    def _visit_part(self, node: ast.Expression) -> None:
        if isinstance(node, ast.Reference):
            self._use(node.start, node.end, self._resolved(node.path, {}, prefers_parts=True))

    def _visit_call(self, node: ast.CallNode, local: Local) -> None:
        path = node.function.text.split(".")
        found = self._resolved(path, local)
        self._use(node.function.start, node.function.end, found)
        self._visit(node.arguments, local)
        for argument in node.named:
            self._use_member(argument.name, found[-1] if len(found) == len(path) else None)
            self._visit(argument.value, local)

    def _visit_reduction(
        self, names: Sequence[ast.NameNode], inside: object, node: ast.SyntaxNode, local: Local
    ) -> None:
        own = {name.text: self.declare("variable", name, node) for name in names}
        self._visit(inside, {**local, **own})
