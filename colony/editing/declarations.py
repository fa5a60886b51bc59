"""The declarations of a program: what each file declares, with the members of each."""

from __future__ import annotations

from collections.abc import Sequence

from colony.dsl import ast
from colony.dsl.check.scope import FileScope
from colony.dsl.check.sequences import DONE, WAITING
from colony.dsl.files import ParsedFile, SourceTree
from colony.editing.index import Declaration

_VALUES = (
    *(ast.EnumDecl, ast.ParamDecl, ast.LetDecl, ast.FunctionDecl, ast.StateDecl, ast.MachineDecl),
    *(ast.SensorDecl, ast.AssumeDecl),
)
_MODULES = (ast.ModuleDecl, ast.DerivedModuleDecl, ast.PythonModuleDecl)
_KINDS: dict[type, str] = {
    ast.SensorDecl: "input",
    ast.EnumDecl: "enum",
    ast.ParamDecl: "param",
    ast.LetDecl: "let",
    ast.FunctionDecl: "function",
    ast.StateDecl: "state",
    ast.MachineDecl: "machine",
    ast.InputDecl: "input",
    ast.ModuleDecl: "module",
    ast.DerivedModuleDecl: "module",
    ast.PythonModuleDecl: "module",
    ast.AssumeDecl: "assume",
}


class DeclarationTable:
    """The declarations of a program. Filled in by `declare_all`, then only read.

    Attributes:
        declarations: All declarations; the types and facts of values are filled in later.
        uses: By file, the start, end and declaration of each name.
        nodes: The syntax node of a declaration, by its number.
        members: By declaration, the numbers of the declarations in it, by name.
        values: By file, the values that it declares, by name; those of the robot are in `robot`.
        parts: By file, the modules, wires and sequences that it declares, by name.
        bases: The modules and tasks that are derived, each with its file and the name of its base.
        declared: The declaration of each name, by file and offset.
    """

    def __init__(self, tree: SourceTree, scopes: Sequence[FileScope]) -> None:
        self.tree = tree
        self.scopes = {scope.file.key: scope for scope in scopes}
        self.numbers = {file.key: i for i, file in enumerate(tree.files)}
        self.declarations: list[Declaration] = []
        self.uses: list[list[tuple[int, int, int]]] = [[] for _ in tree.files]
        self.nodes: dict[int, ast.SyntaxNode] = {}
        self.members: dict[int, dict[str, int]] = {}
        self.robot: dict[str, int] = {}
        self.values: list[dict[str, int]] = [{} for _ in tree.files]
        self.parts: list[dict[str, int]] = [{} for _ in tree.files]
        self.aliases: list[dict[str, int]] = [{} for _ in tree.files]
        self.bases: list[tuple[int, int, ast.Reference]] = []
        self.declared: dict[tuple[int, int], int] = {}
        self._file = 0
        self._text = ""

    def declare_all(self) -> None:
        """Find all declarations."""
        for number, file in enumerate(self.tree.files):
            self._begin(number, file)
            self.declare("file", name_at(file.stem, 0, 0), file.tree)
        for number, file in enumerate(self.tree.files):
            self._begin(number, file)
            for node in file.tree.declarations:
                self._declare(node)

    def _begin(self, number: int, file: ParsedFile) -> None:
        self._file, self._text = number, file.source.text

    # --- declarations

    def declare(self, kind: str, name: ast.NameNode, node: ast.SyntaxNode, parent: int = -1) -> int:
        """Add a declaration of the present file, with its own use; return its number."""
        number = len(self.declarations)
        self.declarations.append(
            Declaration(*(kind, name.text, self._file, name.start, name.end), node.start, node.end, parent)
        )
        self.nodes[number] = node
        if name.end > name.start:
            self.declared[self._file, name.start] = number
            self.uses[self._file].append((name.start, name.end, number))
        if parent >= 0:
            self.members.setdefault(parent, {}).setdefault(name.text, number)
        return number

    def _declare(self, node: ast.Declaration) -> None:
        values, parts = self.values[self._file], self.parts[self._file]
        match node:
            case ast.RobotDecl(items=items):
                robot = self.declare("robot", node.name, node)
                for item in items:
                    self._declare_of_robot(item, robot)
            case ast.ImportDecl(alias=ast.NameNode() as alias):
                self.aliases[self._file].setdefault(alias.text, self.declare("alias", alias, node))
            case ast.SequenceDecl():
                number = self._declare_sequence(node)
                values.setdefault(node.name.text, number)
                parts.setdefault(node.name.text, number)
            case ast.NetworkDecl(wires=wires):
                for wire in wires:
                    if wire.name.text not in self._actuator_names:
                        parts.setdefault(wire.name.text, self.declare("wire", wire.name, wire))
            case ast.AssumeDecl():
                values.setdefault(node.name.text, self.declare("assume", node.name, node))
            case ast.ContractDecl():
                self.declare(node.keyword, node.name, node)
            case ast.TestDecl():
                start = self._text.find('"', node.start)
                self.declare("test", name_at(node.title, start + 1, start + 1 + len(node.title)), node)
            case _ if isinstance(node, _VALUES):
                kind = _KINDS[type(node)]
                number = self._declare_with_members(kind, node)
                values.setdefault(node.name.text, number)
            case _ if isinstance(node, _MODULES):
                number = self.declare("module", node.name, node)
                parts.setdefault(node.name.text, number)
                self._declare_clauses(node, number)
            case _:
                pass

    @property
    def _actuator_names(self) -> set[str]:
        scope = next(iter(self.scopes.values()), None)
        return set() if scope is None else scope.robot.actuator_names

    def _declare_of_robot(self, item: ast.RobotItem, robot: int) -> None:
        match item:
            case ast.SensorDecl():
                number = self.declare("sensor", item.name, item, robot)
            case ast.ActuatorDecl(fields=declared):
                number = self.declare("actuator", item.name, item, robot)
                for field in declared:
                    self.declare("field", field.name, field, number)
            case _:
                return
        self.robot.setdefault(item.name.text, number)

    def _declare_with_members(self, kind: str, node: ast.NamedNode, parent: int = -1) -> int:
        """Declare a value with its members, phases or parameters."""
        number = self.declare(kind, node.name, node, parent)
        match node:
            case ast.EnumDecl(members=members):
                for member in members:
                    self.declare("member", member.name, member, number)
            case ast.MachineDecl(initial=initial, transitions=transitions):
                named = [initial, *(n for t in transitions for n in (t.source, t.target) if n is not None)]
                self._declare_phases(named, number)
            case ast.FunctionDecl(parameters=parameters):
                for parameter in parameters:
                    self.declare("parameter", parameter.name, parameter, number)
            case _:
                pass
        return number

    def _declare_phases(self, names: Sequence[ast.NameNode], machine: int) -> None:
        """Declare phases where they are named first."""
        for name in names:
            if name.text not in self.members.get(machine, {}):
                self.declare("phase", name, name, machine)

    def _declare_sequence(self, node: ast.SequenceDecl) -> int:
        number = self.declare("sequence", node.name, node)
        for task in node.tasks:
            own = self.declare("task", task.name, task, number)
            self.bases.append((own, self._file, task.base))
        ends = [task.otherwise for task in node.tasks if task.otherwise is not None]
        start = node.name.start
        implied = [name_at(DONE, start, start), *([name_at(WAITING, start, start)] if node.when else [])]
        self._declare_phases([*ends, *implied], number)
        return number

    def _declare_clauses(self, node: ast.Declaration, module: int) -> None:
        if isinstance(node, ast.DerivedModuleDecl):
            self.bases.append((module, self._file, node.base))
        elif isinstance(node, ast.ModuleDecl | ast.PythonModuleDecl):
            for clause in node.clauses:
                kind = _KINDS.get(type(clause))
                if kind is not None and isinstance(clause, ast.NamedNode):
                    self._declare_with_members(kind, clause, module)

    def _derive(self, number: int, base: int) -> None:
        declared = self.declarations[number]
        values = {name: getattr(declared, name) for name in declared.__struct_fields__}
        self.declarations[number] = Declaration(**(values | {"base": base}))

    def member(self, owner: int, name: str) -> int | None:
        """Return the member of a declaration, or of what it is derived from."""
        seen = set[int]()
        while owner >= 0 and owner not in seen:
            seen.add(owner)
            found = self.members.get(owner, {}).get(name)
            if found is not None:
                return found
            if self.declarations[owner].kind == "sequence" and name in self._actuator_names:
                return self.robot.get(name)
            owner = self.declarations[owner].base
        return None


def name_at(text: str, start: int, end: int) -> ast.NameNode:
    """Return a name at a place."""
    return ast.NameNode(text=text, start=start, end=end)
