"""Programs written anew with functions, inputs of modules and private names, which must mean the same.

`outlined` takes the text of a drawn program. It makes functions of parts of its expressions (with arguments
by position, by name and by default, with memory inside, in files, in modules and in imported files, called in
several places), inputs of derived modules of what modules read, and private names of lets and states.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import fields
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory
from typing import NamedTuple, TypeVar

from colony.dsl import ast
from colony.dsl.check.calls import FUNCTION_NAMES
from colony.dsl.load import load_text
from colony.dsl.parse import parse
from colony.ir import expression as ir
from colony.ir.expression import MemoryFunction
from colony.ir.program import Program
from colony.ir.types import DIMENSIONLESS, Array, Bool, Enum, Quantity, Type, element_type
from colony.ir.walk import all_subexpressions
from colony.record import Record
from colony.text.source import Source
from colony.verify.testing.agreement import ALL_EXECUTORS, disagreement, reference
from colony.verify.testing.frames import Choices, draw_trace
from tests.drawn.program_text import draw_text

_ROUNDS = 8
_NOT_MEMBERS = frozenset({"mood", "phase", "last"})
"""What may stand before a dot outside contracts: an enum, a machine, and what was sent before."""

Types = dict[tuple[int, int], Type]
_Kind = TypeVar("_Kind", bound=Record)


def outlined_disagreement(seed: int, frames: int = 12) -> str | None:
    """Return how an outlined program differs from its original over a drawn trace, None if it does not."""
    choices = Choices(Random(f"outlined {seed}"))
    text = draw_text(choices, python=True)
    original = load_text(text)
    with TemporaryDirectory() as directory:
        outlined_text = outlined(choices, text, Path(directory))
        program = load_text(outlined_text, directory=directory)
    for number in range(3):
        trace = draw_trace(Choices(Random(f"{seed}/{number}")), original, frames)
        expected = reference(original, trace)
        for frame, (a, b) in enumerate(zip(expected, reference(program, trace), strict=True)):
            if repr(a) != repr(b):
                return f"seed {seed}, trace {number}, frame {frame}: {a}\nis outlined {b}\n{outlined_text}"
        found = disagreement(program, trace, ALL_EXECUTORS, expected)
        if found is not None:
            return f"seed {seed}, trace {number}: {found}\n{outlined_text}"
    return None


def outlined(choices: Choices, text: str, directory: Path) -> str:
    """Return the text of a program with the same meaning; files that it imports go to `directory`."""
    kinds: tuple[Callable[[_Round], str], ...] = (
        _Round.function,
        _Round.function,
        _Round.function,
        _Round.operator,
        _Round.repetition,
        _Round.repetition,
        _Round.inputs,
        _Round.private,
    )
    for number in range(_ROUNDS):
        text = choices.pick(kinds)(_Round(choices, text, number, directory))
    return text


class Edit(NamedTuple):
    """The replacement of `text[start:end]` by `new`."""

    start: int
    end: int
    new: str


class Site(NamedTuple):
    """An expression of a program, where it is written.

    Attributes:
        root: the whole expression.
        declaration: the declaration that it is in.
        place: the offset in the module at which a function for it can be declared, None outside modules.
    """

    root: ast.Expression
    declaration: ast.Declaration
    place: int | None


class Part(NamedTuple):
    """A subexpression, with the variables of the reductions around it."""

    node: ast.Expression
    loops: frozenset[str]


class _Round:
    """One change of a text; each method returns the text as it was if it finds nothing to change."""

    def __init__(self, choices: Choices, text: str, number: int, directory: Path) -> None:
        self.choices, self.text, self.number, self.directory = choices, text, number, directory
        self.file = parse(Source("text", text)).file
        self.types = _types(load_text(text, directory=directory))

    def function(self) -> str:
        """Make a function of a part of an expression."""
        sites = list(_sites(self.file, self.text))
        site = self.choices.pick(sites)
        parts = [p for p in _parts(site.root) if self.type_of(p.node) is not None]
        if not parts:
            return self.text
        part = self.choices.pick(parts)
        holes = self.holes(part)
        if holes is None:
            return self.text
        local = _local_names(site.declaration)
        left = _free_names(part.node, holes)
        if any(len(path) > 1 and path[0] not in _NOT_MEMBERS for path in left):
            return self.text  # only contracts can read members of modules and actuators
        is_local = any(path[0] in local for path in left) or self.choices.one_in(3)
        if is_local and site.place is not None:
            place = site.place
        else:
            place = site.declaration.start
        return self.with_function(part.node, holes, place)

    def with_function(self, node: ast.Expression, holes: list[ast.Expression], place: int) -> str:
        """Return the text with a function of a node, whose arguments are the holes, declared at `place`."""
        name, parameters, given = f"f{self.number}", list[str](), list[str]()
        used: dict[tuple[str, Type], str] = {}
        body: list[Edit] = []
        start, end = self.extent(node)
        by_name = False
        for hole in holes:
            type_, text = self.types[hole.start, hole.end], self.written(hole)
            parameter = used.get((text, type_))
            if parameter is None:
                parameter = used[text, type_] = f"p{len(used)}"
                has_default = isinstance(hole, ast.NumberNode) and bool(hole.unit) and self.choices.one_in(2)
                parameters.append(self.declared(parameter, type_) + (f" = {text}" if has_default else ""))
                is_given = not has_default or self.choices.one_in(3)
                by_name |= not is_given or self.choices.one_in(4)
                given += [f"{parameter} = {text}" if by_name else text] if is_given else []
            hole_start, hole_end = self.extent(hole)
            body.append(Edit(hole_start - start, hole_end - start, parameter))
        value = _edited(self.text[start:end], body)
        declaration = f"let {name}({', '.join(parameters)}) = {value}\n"
        call = Edit(start, end, f"{name}({', '.join(given)})")
        return _edited(self.text, [Edit(place, place, declaration), call])

    def holes(self, part: Part) -> list[ast.Expression] | None:
        """Choose what becomes an argument; what reads a variable of a reduction outside must."""
        chosen: list[ast.Expression] = []
        candidates: list[ast.Expression] = []
        for inner in _parts(part.node):
            if inner.node is part.node and isinstance(inner.node, ast.Reference):
                continue
            own = inner.loops & {path[0] for path in _free_names(inner.node, [])}
            if isinstance(inner.node, ast.Reference) and inner.node.path[0] in part.loops - inner.loops:
                if self.type_of(inner.node) is None:
                    return None
                chosen.append(inner.node)
            elif inner.node is not part.node and not own and self.is_argument(inner.node):
                candidates.append(inner.node)
        if part.loops & {path[0] for path in _free_names(part.node, chosen)}:
            return None
        for _ in range(self.choices.up_to(3) if candidates else 0):
            candidate = self.choices.pick(candidates)
            if not any(_overlap(candidate, other) for other in chosen):
                chosen.append(candidate)
        return sorted(chosen, key=lambda node: node.start)

    def repetition(self) -> str:
        """Give a part of an expression to a function that reads it twice, or within a reduction."""
        site = self.choices.pick(list(_sites(self.file, self.text)))
        parts = [p.node for p in _parts(site.root) if self.is_argument(p.node)]
        parts = [n for n in parts if _has_memory(n)] or parts
        if not parts:
            return self.text
        node = self.choices.pick(parts)
        type_ = self.types[node.start, node.end]
        bodies = ["if true then p else p"]
        if isinstance(type_, Bool):
            bodies += ["p and p", "any(p for k0 in 0 .. 1)", "all(p for k1 in 0 .. 1)"]
        elif isinstance(type_, Quantity):
            bodies += ["max(p for k0 in 0 .. 1)", "min(max(p for k0 in 0 .. 1) for k1 in 1 .. 2)"]
        declaration = f"let r{self.number}({self.declared('p', type_)}) = {self.choices.pick(bodies)}\n"
        start, end = self.extent(node)
        place = site.declaration.start
        call = Edit(start, end, f"r{self.number}({self.written(node)})")
        return _edited(self.text, [Edit(place, place, declaration), call])

    def operator(self) -> str:
        """Make one function of an operator or timer, and call it in several places."""
        groups: dict[tuple[object, ...], list[ast.Expression]] = {}
        for site in _sites(self.file, self.text):
            for part in _parts(site.root):
                key = self.operation(part.node)
                if key is not None:
                    groups.setdefault(key, []).append(part.node)
        if not groups:
            return self.text
        key = self.choices.pick(list(groups))
        edits: list[Edit] = []
        for node in groups[key]:
            start, end = self.extent(node)
            if all(e.end <= start or end <= e.start for e in edits) and not self.choices.one_in(4):
                edits.append(Edit(start, end, self.operator_call(node)))
        name, types = f"o{self.number}", key[1:]
        first = self.declared("a", types[0])  # type: ignore[arg-type]
        if key[0] in ("recently", "sustained"):
            head, body = f"({first}, t : s = 1 s)", f"{key[0]}(a, t)"
        else:
            head, body = f"({first}, {self.declared('b', types[1])})", f"a {key[0]} b"  # type: ignore[arg-type]
        if Enum in map(type, map(element_type, types)) or self.choices.one_in(2):  # type: ignore[arg-type]
            robot = next(d for d in self.file.declarations if isinstance(d, ast.RobotDecl))
            return _edited(self.text, [*edits, Edit(robot.end, robot.end, f"\nlet {name}{head} = {body}")])
        call = "_own(a, t)" if " t : s" in head else "_own(a, b)"
        library = f"let _own{head} = {body}\nlet {name}{head} = {call}\n"
        (self.directory / f"library{self.number}.colony").write_text(library)
        return f'import "library{self.number}"\n{_edited(self.text, edits)}'

    def operation(self, node: ast.Expression) -> tuple[object, ...] | None:
        """Return what two calls of one function have in common."""
        match node:
            case ast.Infix(operator=operator, left=left, right=right):
                if self.is_argument(left) and self.is_argument(right) and self.type_of(node) is not None:
                    return (operator, self.type_of(left), self.type_of(right))
            case ast.CallNode(function=function, arguments=(argument, _)):
                if function.text in ("recently", "sustained") and self.is_argument(argument):
                    return (function.text, self.type_of(argument))
            case _:
                pass
        return None

    def operator_call(self, node: ast.Expression) -> str:
        """Return a call of the function of this round in the place of a node."""
        assert isinstance(node, ast.Infix | ast.CallNode)
        parts = (node.left, node.right) if isinstance(node, ast.Infix) else node.arguments
        a, b = (self.written(p) for p in parts)
        second = "b" if isinstance(node, ast.Infix) else "t"
        shown = self.choices.pick((f"{a}, {b}", f"{a}, {second} = {b}", f"{second} = {b}, a = {a}"))
        return f"o{self.number}({shown})"

    def inputs(self) -> str:
        """Make a module a template, from which it is derived with what it reads as inputs."""
        modules = [d for d in self.file.declarations if isinstance(d, ast.ModuleDecl | ast.PythonModuleDecl)]
        module = self.choices.pick(modules)
        if isinstance(module, ast.PythonModuleDecl):
            return self.python_input(module)
        lets = {d.name.text: d for d in self.file.declarations if isinstance(d, ast.LetDecl)}
        local = _local_names(module) | _loop_names(module)
        reads: dict[str, list[ast.Reference]] = {}
        asked = {
            call.arguments[0].text
            for call in _records(module, ast.CallNode)
            if call.function.text == "fresh" and isinstance(call.arguments[0], ast.Reference)
        }
        for node in _records(module, ast.Reference):
            name = node.path[0]
            is_free = len(node.path) == 1 and name not in local and not name.startswith(("p", "now"))
            if is_free and (name in lets or name not in asked):
                reads.setdefault(name, []).append(node)
        typed = {n: t for n, nodes in reads.items() if (t := self.input_type(nodes)) is not None}
        if not typed or any(isinstance(c, ast.FunctionDecl | ast.InputDecl) for c in module.clauses):
            return self.text
        names = list(dict.fromkeys(self.choices.pick(list(typed)) for _ in range(2)))
        edits, bound, declared = list[Edit](), list[tuple[str, str]](), list[str]()
        for i, name in enumerate(names):
            own = f"i{self.number}{i}"
            edits += [Edit(n.start, n.end, own) for n in reads[name]]
            value = name
            if name in lets and self.choices.one_in(2):
                value = self.written(lets[name].value)
            default = f" = {value}" if self.choices.one_in(3) else ""
            declared.append(f"  input {self.declared(own, typed[name])}{default}\n")
            bound += [] if default else [(own, value)]
        return self.derived(module, edits, declared, bound)

    def derived(
        self, module: ast.ModuleDecl, edits: list[Edit], declared: list[str], bound: list[tuple[str, str]]
    ) -> str:
        """Return the text with a module that has inputs, and one in its place that is derived from it."""
        brace = self.text.index("{", module.name.end) + 1
        edits.append(Edit(brace, brace, "\n" + "".join(declared)))
        failsafe = "failsafe " if module.failsafe else ""
        if not bound and self.choices.one_in(2):
            return _edited(self.text, edits)  # the defaults bind all
        if not bound:
            return self.text
        name, base = module.name.text, f"t{self.number}"
        edits.append(Edit(module.name.start, module.name.end, base))
        lines = ""
        if len(bound) > 1 and self.choices.one_in(2):
            lines += f"\nmodule u{self.number} = {base}({bound[0][0]} = {bound[0][1]})"
            base, bound = f"u{self.number}", bound[1:]
        given = ", ".join(f"{own} = {value}" for own, value in bound)
        lines += f"\n{failsafe if self.choices.one_in(2) else ''}module {name} = {base}({given})"
        edits.append(Edit(module.end, module.end, lines))
        return _edited(self.text, edits)

    def python_input(self, module: ast.PythonModuleDecl) -> str:
        """Make an input, with a default, of what a module in Python reads."""
        reads = next((c for c in module.clauses if isinstance(c, ast.ReadsDecl)), None)
        if reads is None:
            return self.text
        node = self.choices.pick(reads.names)
        sensors = {s.name.text: s for s in _records(self.file, ast.SensorDecl)}
        sensor = sensors.get(node.text)
        if sensor is None:
            return self.text
        size = "" if sensor.size is None else f"[{self.written(sensor.size)}]"
        if sensor.bearing is not None:
            size = "[]"  # an array of a given size has no bearings before its argument is known
        own = f"input {node.text}{size} : {'.'.join(sensor.type.path)} = {node.text}\n  "
        others = [n.text for n in reads.names if n is not node]
        kept = f"reads {', '.join(others)}" if others else ""
        return _edited(self.text, [Edit(reads.start, reads.end, own + kept)])

    def input_type(self, nodes: Sequence[ast.Reference]) -> Type | None:
        """Return the type of what these references read, None if no input can have it."""
        return next((self.type_of(n) for n in nodes if self.is_argument(n)), None)

    def private(self) -> str:
        """Make the name of a let or state private."""
        kinds = (ast.LetDecl, ast.StateDecl)
        names = [d.name.text for d in self.file.declarations if isinstance(d, kinds)]
        if not names:
            return self.text
        name = self.choices.pick(names)
        found = [n for n in _records(self.file, ast.Reference) if n.path[0] == name]
        places = [n.start for n in found]
        places += [d.name.start for d in self.file.declarations if _declares(d, name)]  # type: ignore[union-attr]
        return _edited(self.text, [Edit(p, p, "_") for p in set(places)])

    # --- text and types

    def extent(self, node: ast.Expression) -> tuple[int, int]:
        """Return where a node is written, with the parentheses that belong to its parts."""
        start, end = node.start, node.end
        opened = closed = 0
        for character in self.text[start:end]:
            if character == "(":
                opened += 1
            elif character == ")" and opened:
                opened -= 1
            elif character == ")":
                closed += 1
        for _ in range(closed):
            start = self.text.rindex("(", 0, start)
        for _ in range(opened):
            end = self.text.index(")", end) + 1
        return start, end

    def written(self, node: ast.Expression) -> str:
        """Return the text of a node."""
        start, end = self.extent(node)
        return self.text[start:end]

    def type_of(self, node: ast.Expression) -> Type | None:
        """Return the type of an expression, None for a lone 0 and for what the program does not have."""
        found = self.types.get((node.start, node.end))
        element = None if found is None else element_type(found)
        return None if isinstance(element, Quantity) and element.wildcard else found

    def is_argument(self, node: ast.Expression) -> bool:
        """Return True if a parameter can have the type of an expression."""
        found = self.type_of(node)
        element = None if found is None else element_type(found)
        return found is not None and not (isinstance(element, Enum) and element.kind == "machine")

    def declared(self, name: str, type_: Type) -> str:
        """Return the declaration of a parameter."""
        element = element_type(type_)
        unit = "number" if element == DIMENSIONLESS else "bool" if isinstance(element, Bool) else str(element)
        size = ""
        if isinstance(type_, Array) and type_.bearings is None:  # else they come with the argument
            size = self.choices.pick((str(type_.size), ""))
        return f"{name}[{size}] : {unit}" if isinstance(type_, Array) else f"{name} : {unit}"


# --- what a text has -------------------------------------------------------------------------------


def _types(program: Program) -> Types:
    found: Types = {}
    for e in all_subexpressions(program):
        if e.span.source.name == "<text>":
            found[e.span.start, e.span.end] = e.type
    for e in all_subexpressions(program):
        if isinstance(e, ir.Element) and isinstance(e.index, ir.Constant):
            found.pop((e.index.span.start, e.index.span.end), None)  # it may be an angle
        elif isinstance(e, ir.FunctionCall) and e.function in ir.INDEX_FUNCTIONS:
            (array,) = e.arguments  # of a slice the index is one of the whole, of an argument it is not
            found.pop((array.span.start, array.span.end), None)
        elif isinstance(e, ir.Reduce) and len(e.arrays) > 1:
            _, array = e.arrays[0]  # the second has the bearings of the first
            found[array.span.start, array.span.end] = array.type
    return found


def _sites(file: ast.File, text: str) -> Iterator[Site]:
    for d in file.declarations:
        match d:
            case ast.LetDecl(value=root) | ast.NextDecl(value=root) | ast.ContractDecl(expression=root):
                yield Site(root, d, None)
            case ast.MachineDecl(transitions=transitions):
                yield from (Site(t.condition, d, None) for t in transitions)
            case ast.LimitDecl(bound=bound, condition=condition):
                yield from (Site(root, d, None) for root in (bound, condition) if root is not None)
            case ast.ModuleDecl(clauses=clauses, when=when, do=do):
                for clause in clauses:
                    if isinstance(clause, ast.LetDecl | ast.NextDecl):
                        yield Site(clause.value, d, clause.start)
                end = text.rindex("when", 0, when.start)
                roots = (when, *(a.value for a in (do.arguments if do else ())))
                yield from (Site(root, d, end) for root in roots)
            case _:
                pass


_COMPREHENSIONS = (ast.Comprehension, ast.ElementsComprehension)


def _parts(root: ast.Expression, loops: frozenset[str] = frozenset()) -> Iterator[Part]:
    """Yield an expression and all its subexpressions."""
    yield Part(root, loops)
    for field in fields(root):
        inner = loops
        if isinstance(root, _COMPREHENSIONS) and field.name in ("body", "condition"):
            inner = loops | {root.variable.text}
            if isinstance(root, ast.ElementsComprehension) and root.bearing is not None:
                inner |= {root.bearing.text}
        for child in _flat(getattr(root, field.name)):
            node = child.value if isinstance(child, ast.Argument) else child
            if isinstance(node, ast.ExpressionNode):
                yield from _parts(node, inner)  # type: ignore[arg-type]


def _free_names(root: ast.Expression, holes: Sequence[ast.Expression]) -> set[tuple[str, ...]]:
    """Return the names that an expression reads or calls outside its holes."""
    found: set[tuple[str, ...]] = set()
    for node, loops in _parts(root):
        if any(h.start <= node.start and node.end <= h.end for h in holes):
            continue
        match node:
            case ast.Reference(path=path) if path[0] not in loops:
                found.add(path)
            case ast.CallNode(function=function) if function.text not in FUNCTION_NAMES:
                found.add((function.text,))
            case ast.By() | ast.Is():
                found.add(("part", "of a contract"))
            case _:
                pass
    return found


def _has_memory(root: ast.Expression) -> bool:
    names = {function.value for function in MemoryFunction}
    return any(isinstance(p.node, ast.CallNode) and p.node.function.text in names for p in _parts(root))


def _local_names(declaration: ast.Declaration) -> frozenset[str]:
    if not isinstance(declaration, ast.ModuleDecl):
        return frozenset()
    return frozenset(c.name.text for c in declaration.clauses if not isinstance(c, ast.NextDecl))


def _loop_names(declaration: ast.Declaration) -> frozenset[str]:
    elements = list(_records(declaration, ast.ElementsComprehension))
    loops = [c.variable for c in _records(declaration, ast.Comprehension)]
    loops += [c.variable for c in elements]
    bearings = [c.bearing for c in elements if c.bearing is not None]
    return frozenset(n.text for n in (*loops, *bearings))


def _records(root: Record, kind: type[_Kind]) -> Iterator[_Kind]:
    """Yield a record, and all in it, that are of a kind."""
    if isinstance(root, kind):
        yield root
    for field in fields(root):  # type: ignore[arg-type]
        for child in _flat(getattr(root, field.name)):
            yield from _records(child, kind)


def _flat(value: object) -> Iterator[Record]:
    if isinstance(value, Record):
        yield value
    elif isinstance(value, tuple):
        for part in value:
            yield from _flat(part)


def _declares(declaration: ast.Declaration, name: str) -> bool:
    kinds = (ast.LetDecl, ast.StateDecl, ast.NextDecl)
    return isinstance(declaration, kinds) and declaration.name.text == name


def _overlap(a: ast.Expression, b: ast.Expression) -> bool:
    return a.start < b.end and b.start < a.end


def _edited(text: str, edits: Sequence[Edit]) -> str:
    for start, end, new in sorted(edits, reverse=True):
        text = text[:start] + new + text[end:]
    return text
