"""Generation of a program as C99: a header and a source, for a microcontroller or a host.

The step is laid out as in generated Python (`python/plan.py`): the clients of an actuator are a chain of
`if`s in order of priority. It allocates nothing, does not recurse, and keeps all memory in one struct.
Numbers are doubles, times whole nanoseconds.
"""

from __future__ import annotations

import re
import textwrap
from dataclasses import dataclass
from functools import cache
from pathlib import Path, PurePath

from colony.compile.backends.c.decision import decision_lines
from colony.compile.backends.c.expressions import KEYWORDS, OWN, TYPES, CTexts, identifier, literal
from colony.compile.backends.c.sensors import sensor_lines, sensor_members
from colony.compile.backends.python.plan import (
    ActuatorPlan,
    ClientPlan,
    FunctionLayout,
    Placement,
    make_plan,
)
from colony.compile.backends.python.text import Precedence, UniqueNames, ranges
from colony.execute.code import ClientCode
from colony.execute.compiled import Compiled
from colony.execute.needs import whole_view
from colony.ir.program import Role
from colony.ir.types import Bool
from colony.ir.version import SEMANTICS
from colony.text.diagnostics import DiagnosticError, error
from colony.text.source import Span

_NOTHING = "    uint8_t nothing;"
"""The only member of an outcome without any: C has no empty structs."""
_INCLUDES = ("#include <stdbool.h>", "#include <stdint.h>")
_WIDTH = 116

TYPES_TEXT = """\
#ifndef COLONY_TYPES
#define COLONY_TYPES

/* What a frame has of a sensor. Absent is missing, or, of what was sent before, what the program sent. */
enum colony_given { COLONY_ABSENT = 0, COLONY_GIVEN = 1, COLONY_FAULTY = 2, COLONY_LOST = 3 };

/* What the step found of a sensor. */
enum colony_found { COLONY_MISSING = 0, COLONY_FRESH = 1, COLONY_CLAMPED = 2, COLONY_FAULT = 3 };

/* Why the winner's command was not sent. */
enum colony_reason { COLONY_OK = 0, COLONY_BLIND = 1, COLONY_NOT_FINITE = 2, COLONY_BOUND_MISSING = 3,
                     COLONY_CONTRADICTION = 4 };

/* How a field of a command was changed: by a limit, or by the range of the actuator. */
enum colony_change { COLONY_UNCHANGED = 0, COLONY_LIMITED = 1, COLONY_RANGE = 2 };

#endif
"""

GUARDS = """\
#if DBL_MANT_DIG != 53 || DBL_MAX_EXP != 1024
#error "double must have 64 bits"
#endif
#if defined(FLT_EVAL_METHOD) && FLT_EVAL_METHOD != 0 && FLT_EVAL_METHOD != 16
#error "doubles must be computed as doubles: FLT_EVAL_METHOD must be 0"
#endif
#ifdef __FAST_MATH__
#error "compile without -ffast-math"
#endif
#if defined(__FP_FAST_FMA) && !defined(__clang__) && !defined(__STRICT_ANSI__)
#ifndef COLONY_NO_CONTRACTION
#error "compile with -std=c99, or with -ffp-contract=off -DCOLONY_NO_CONTRACTION"
#endif
#endif
#ifdef __clang__
#pragma STDC FP_CONTRACT OFF
#endif
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class CText:
    """A program in C: `header` is the text of NAME.h, `source` that of NAME.c, which includes it.

    `sensors` and `actuators` are the members of frame and outcome, and `modules` the names of the modules by
    number, beginning with 1.
    """

    name: str
    header: str
    source: str
    sensors: tuple[str, ...]
    actuators: tuple[str, ...]
    modules: tuple[str, ...]
    compiled: Compiled


def generate_c(compiled: Compiled, name: str = "") -> CText:
    """Return a program in C, called `name`, by default like its robot.

    Raises:
        DiagnosticError: C002, it has a module in Python.
    """
    return _Generator(compiled, name or compiled.name).text()


def program_name(name: str) -> str:
    """Return the name of files, types and functions of a program that is called `name`."""
    word = identifier(name).lower()
    return f"c_{word}" if word.startswith("colony") else word


class _Generator:
    """A generator of one program. Mutable."""

    def __init__(self, compiled: Compiled, name: str) -> None:
        if compiled.code.python:
            call = compiled.code.python[0]
            message = f"`{call.module}` is a module in Python, which C cannot call"
            hint = "write the module in the language, or compile to Python"
            raise DiagnosticError([error("C002", call.span, message, hint)])
        self.compiled, self.title, self.prefix = compiled, compiled.name, program_name(name)
        self.code = code = whole_view(compiled.code)
        self.ranges = ranges(code)
        layout = FunctionLayout()
        self.placement = Placement(code, layout, self.ranges)
        self.plan = make_plan(code, layout, self.placement, grouped=False)
        self.nobody = self._constant("nobody")
        self.modules = self._constants([c.module for a in code.actuators for c in a.clients])
        own = {self.nobody, *self.modules.values()}
        self.names = UniqueNames(code, KEYWORDS | OWN | set(definitions()) | own)
        self.readings = _members([s.name for s in code.sensors], "t_ns", "restarted")
        self.outcomes = _members([a.actuator.name for a in code.actuators], "found", "broken", "nothing")
        self.expressions = CTexts(code, self.placement, self.ranges, self.names, self.modules)
        self.sent = [sensor for sensor in code.sensors if sensor.sent is not None]
        self.cells = [cell for commit in self.plan.commits for cell in commit.cells]
        self.lines: list[str] = []

    def _constant(self, name: str) -> str:
        return f"{self.prefix}_{identifier(name)}".upper()

    def _constants(self, modules: list[str]) -> dict[str, str]:
        """Return a unique constant for each module."""
        constants: dict[str, str] = {}
        taken = {self.nobody}
        for module in modules:
            if module not in constants:
                constant = base = self._constant(module)
                while constant in taken:
                    constant = f"{base}_{len(taken)}"
                taken.add(constant)
                constants[module] = constant
        return constants

    # --- files -----------------------------------------------------------------------------------

    def text(self) -> CText:
        """Return both files."""
        body = self.step()
        functions = self.initial() + body
        head = [
            f"/* Clients of {_comment(self.title)}, by `colony compile`, semantics version {SEMANTICS}. "
            "Changes here will be lost. */",
            "",
        ]
        source = [
            *head,
            f'#include "{self.prefix}.h"',
            "",
            "#include <float.h>",
            "#include <math.h>",
            "",
            GUARDS,
            *self.tables(),
            *support(set(re.findall(r"\w+", "\n".join(functions)))),
            *functions,
        ]
        return CText(
            name=self.prefix,
            header="\n".join([*head, *self.header()]) + "\n",
            source=_joined(source),
            sensors=tuple(self.readings.values()),
            actuators=tuple(self.outcomes.values()),
            modules=tuple(self.modules),
            compiled=self.compiled,
        )

    def header(self) -> list[str]:
        """Return the types and functions."""
        p, guard = self.prefix, _guard(self.prefix)
        tables = [f"extern const char *const {p}_{table}[];" for table, _ in self._tables()]
        constants = [self.nobody, *self.modules.values()]
        return [
            f"#ifndef {guard}",
            f"#define {guard}",
            "",
            *_INCLUDES,
            "",
            TYPES_TEXT,
            "/* The modules that can win. */",
            f"enum {p}_module {{",
            *[f"    {constant} = {i}," for i, constant in enumerate(constants)],
            "};",
            "",
            "/* The names of modules (by number), sensors, actuators and contracts. */",
            *tables,
            "",
            "/* One frame: readings in their declared units. Times are from 0 to 2^62 ns, and rise. */",
            f"struct {p}_frame {{",
            "    int64_t t_ns;",
            "    bool restarted; /* true in the first frame after memory was lost */",
            *[
                line
                for sensor in self.code.sensors
                for line in sensor_members(sensor, self.readings[sensor.name])
            ],
            "};",
            "",
            "/* What was decided: for each actuator the winner and its command in declared units. */",
            f"struct {p}_outcome {{",
            *self.outcome_members(),
            "};",
            "",
            "/* All that is remembered from frame to frame. */",
            f"struct {p}_memory {{",
            "    int64_t first_ns;",
            "    bool begun;",
            "    bool restarted;",
            *[f"    {TYPES[self.code.cells[c].kind]} {self.names.cells[c]};" for c in self.cells],
            *[
                f"    struct {{ {_type(isinstance(s.type, Bool))} value; bool known; }} "
                f"{self.names.last[s.name]};"
                for s in self.sent
            ],
            "};",
            "",
            "/* Begin a run. */",
            f"void {p}_init(struct {p}_memory *m);",
            "",
            "/* Begin again after memory was lost in a run: the next frame is `restarted`. */",
            f"void {p}_restart(struct {p}_memory *m);",
            "",
            "/* Decide one frame. */",
            f"void {p}_step(struct {p}_memory *m, const struct {p}_frame *f, struct {p}_outcome *out);",
            "",
            "#endif",
        ]

    def outcome_members(self) -> list[str]:
        """Return the members of the outcome."""
        lines = []
        for a in self.code.actuators:
            fields = a.actuator.fields
            lines += ["    struct {", f"        enum {self.prefix}_module by;"]
            lines += [
                "        uint8_t reason; /* enum colony_reason */",
                "        uint8_t reason_field;",
                "        bool sent;",
            ]
            if fields:
                lines += [
                    f"        uint8_t changed[{len(fields)}]; /* enum colony_change */",
                    "        struct {",
                ]
                lines += [
                    f"            {_type(isinstance(f.type, Bool))} {identifier(f.name)};"
                    + (f" /* {_comment(f.unit)} */" if f.unit else "")
                    for f in fields
                ]
                lines += ["        } command;"]
            lines += [f"    }} {self.outcomes[a.actuator.name]};"]
        if self.code.sensors:
            lines.append(f"    uint8_t found[{len(self.code.sensors)}]; /* enum colony_found */")
        if self.code.contracts:
            lines.append(f"    bool broken[{len(self.code.contracts)}];")
        return lines or [_NOTHING]

    def _tables(self) -> list[tuple[str, list[str]]]:
        actuators = [a.actuator.name for a in self.code.actuators]
        return [
            ("modules", ["", *self.modules]),
            ("sensors", [s.name for s in self.code.sensors]),
            ("actuators", actuators),
            ("contracts", [c.name for c in self.code.contracts]),
        ]

    def tables(self) -> list[str]:
        """Return the tables of names; one that is empty has an empty name."""
        lines = []
        for table, names in self._tables():
            listed = ", ".join(f'"{_comment(name)}"' for name in names or [""])
            lines += [f"const char *const {self.prefix}_{table}[] = {{{listed}}};"]
        return [*lines, ""]

    def initial(self) -> list[str]:
        """Return the functions that set the initial memory."""
        p = self.prefix
        cells = [
            f"    m->{self.names.cells[c]} = {literal(self.code.cells[c].initial).text};" for c in self.cells
        ]
        for sensor in self.sent:
            kept, zero = self.names.last[sensor.name], "false" if isinstance(sensor.type, Bool) else "0.0"
            cells += [f"    m->{kept}.value = {zero};", f"    m->{kept}.known = false;"]
        begin = [
            "{",
            "    m->first_ns = INT64_C(0);",
            "    m->begun = false;",
            "    m->restarted = false;",
            *cells,
            "}",
        ]
        again = ["{", f"    {p}_init(m);", "    m->restarted = true;", "}", ""]
        memory = f"(struct {p}_memory *m)"
        return [f"void {p}_init{memory}", *begin, "", f"void {p}_restart{memory}", *again]

    # --- the step --------------------------------------------------------------------------------

    def add(self, indent: int, *lines: str) -> None:
        self.lines.extend("    " * indent + line for line in lines)

    def before(self, slot: int, indent: int) -> None:
        """Add the statements that belong to a slot."""
        self.add(indent, *self.expressions.statements.get(slot, ()))

    def value(self, number: int) -> str:
        return self.expressions.text(number).text

    def step(self) -> list[str]:
        """Return the function that decides a frame."""
        p = self.prefix
        for plan in self.plan.actuators:
            self.actuator(plan)
        self.contracts()
        self.remember_active()
        self.memory()
        self.remember_sent()
        body, self.lines = _without_unused(self.lines), []
        used = {word for line in body for word in _words(line)}
        self.add(1, "if (!m->begun) {", "    m->begun = true;", "    m->first_ns = f->t_ns;", "}")
        if "t" in used:
            self.add(1, "const int64_t t = f->t_ns - m->first_ns;")
        if "restarted" in used:
            self.add(1, "const bool restarted = f->restarted || m->restarted;")
        self.add(1, "m->restarted = false;")
        if self.outcome_members() == [_NOTHING]:
            self.add(1, "out->nothing = 0;")
        for i, sensor in enumerate(self.code.sensors):
            self.add(1, *sensor_lines(sensor, i, self.readings[sensor.name], self.names, used))
        head = f"void {p}_step(struct {p}_memory *m, const struct {p}_frame *f, struct {p}_outcome *out)"
        return [head, "{", *self.lines, *body, "}"]

    def actuator(self, plan: ActuatorPlan) -> None:
        """Add the chain of clients, then the decision."""
        actuator = plan.actuator.actuator
        name, by = actuator.name, self.names.by[actuator.name]
        self.add(0, "")
        self.add(1, f"/* {_comment(name + _place(actuator.span))} */")
        self.before(plan.slot, 1)
        self.add(1, f"enum {self.prefix}_module {by} = {self.nobody};")
        if plan.may_be_blind:
            self.add(1, f"bool {self.names.blind[name]} = false;")
        for i, field in enumerate(actuator.fields):
            is_bool = isinstance(field.type, Bool)
            zero = "false" if is_bool else "0.0"
            self.add(1, f"{_type(is_bool)} {self.names.field[name, i]} = {zero};")
        if plan.groups:
            self.add(1, "do {")
            for group in plan.groups:
                self.before(group.slot, 2)
                for client in group.clients:
                    self.client(plan, client, 2)
            self.add(1, "} while (false);")
        self.before(plan.after, 1)
        statements = self.expressions.statements.get(plan.limits, [])
        self.add(
            1,
            *decision_lines(
                plan, f"out->{self.outcomes[name]}", self.names, self.expressions, statements, self.nobody
            ),
        )

    def client(self, plan: ActuatorPlan, client: ClientPlan, indent: int) -> None:
        """Add one client."""
        guard, origin = self.value(client.client.guard), _origin(client.client)
        self.before(client.slot, indent)
        self.add(indent, f"/* {origin} */")
        if guard != "true":
            self.add(indent, f"if ({guard}) {{")
            indent += 1
        name = plan.actuator.actuator.name
        self.before(client.body, indent)
        self.add(indent, f"{self.names.by[name]} = {self.modules[client.client.module]};")
        known = self.expressions.text(client.client.known)
        if known.text != "true":
            self.add(indent, f"{self.names.blind[name]} = !{known.inside(Precedence.SIGN)};")
        for i, value in enumerate(client.client.fields):
            self.add(indent, f"{self.names.field[name, i]} = {self.value(value)};")
        self.add(indent, "break;")
        if guard != "true":
            self.add(indent - 1, "}")

    def contracts(self) -> None:
        if self.plan.contracts:
            self.add(0, "")
            self.add(1, "/* contracts */")
        for i, (contract, slot) in enumerate(self.plan.contracts):
            self.before(slot, 1)
            holds = self.expressions.text(contract.holds).inside(Precedence.SIGN)
            self.add(1, f"out->broken[{i}] = !{holds}; /* {_comment(contract.name)} */")

    def memory(self) -> None:
        if self.plan.commits:
            self.add(0, "")
            self.add(1, "/* memory */")
        self.before(self.plan.memory_slot, 1)
        for commit in self.plan.commits:
            self.before(commit.slot, 1)
            condition = self.value(commit.condition)
            always = condition == "true"
            if not always:
                self.add(1, f"if ({condition}) {{")
            indent = 1 if always else 2
            self.before(commit.body, indent)
            for cell in commit.cells:
                value = self.value(self.code.cells[cell].value)
                self.add(indent, f"m->{self.names.cells[cell]} = {value};")
            if not always:
                self.add(1, "}")

    def remember_active(self) -> None:
        """Keep what is `last.MODULE is active` in the next frame, unless a reading says otherwise."""
        self.before(self.plan.activity_slot, 1)
        for name, active in self.plan.activity:
            kept = self.names.last[name]
            self.add(1, f"m->{kept}.value = {self.value(active)};", f"m->{kept}.known = true;")

    def remember_sent(self) -> None:
        """Keep what else is `last...` in the next frame, unless a reading says otherwise."""
        actuators = {a.actuator.name: a.actuator for a in self.code.actuators}
        for sensor in self.sent:
            assert sensor.sent is not None
            name, of, kept = sensor.sent.actuator, sensor.sent.of, self.names.last[sensor.name]
            if isinstance(of, Role):
                if of.kind == "by":
                    module = self.modules.get(of.module)
                    won = "false" if module is None else f"{self.names.by[name]} == {module}"
                    self.add(1, f"m->{kept}.value = {won};", f"m->{kept}.known = true;")
                continue
            out = f"out->{self.outcomes[name]}"
            command = f"{out}.command.{identifier(actuators[name].fields[of].name)}"
            keep = [f"m->{kept}.value = {command};", f"m->{kept}.known = true;"]
            if actuators[name].idle is None:
                keep = [f"if ({out}.sent) {{", *(f"    {line}" for line in keep), "}"]
            self.add(1, *keep)


def _members(names: list[str], *taken: str) -> dict[str, str]:
    """Return the member of a struct for each name."""
    members: dict[str, str] = {}
    for name in names:
        member = identifier(name)
        while member in taken or member in members.values():
            member += "_"
        members[name] = member
    return members


def _type(is_bool: bool) -> str:
    return "bool" if is_bool else "double"


def _place(span: Span) -> str:
    """Return file and line of a declaration, after a comma."""
    source = span.source
    return (
        "" if source.name == "<none>" else f", {PurePath(source.name).name}:{source.position(span.start)[0]}"
    )


def _origin(client: ClientCode) -> str:
    """Return the module, its priority and its source line, for a comment."""
    return _comment(f"{client.module}, priority {client.priority}{_place(client.span)}")


def _comment(text: str) -> str:
    """Return a text for a comment or a string literal."""
    return "".join(c if c.isascii() and c.isprintable() and c not in '"\\?' else "_" for c in text).replace(
        "*/", "__"
    )


# --- lines --------------------------------------------------------------------------------------------

_NAMED = re.compile(r"\s*const (?:double|bool|int64_t)(?: \*const)? (\w+) = ")


def _without_unused(lines: list[str]) -> list[str]:
    """Return the lines without constants that none of them uses."""
    counts: dict[str, int] = {}
    words = [_words(line) for line in lines]
    for own in words:
        for word in own:
            counts[word] = counts.get(word, 0) + 1
    kept = []
    for line, own in zip(reversed(lines), reversed(words), strict=True):
        named = _NAMED.match(line)
        if named is not None and counts[named[1]] == 1:
            for word in own:
                counts[word] -= 1
        else:
            kept.append(line)
    return kept[::-1]


def _words(line: str) -> list[str]:
    """Return the words of a line without those of its comment."""
    return re.findall(r"\w+", re.sub(r"/\*.*?\*/", "", line))


def _joined(lines: list[str]) -> str:
    """Return a text with long lines of code broken."""
    return "\n".join(part for line in lines for part in _wrapped(line)) + "\n"


def _wrapped(line: str) -> list[str]:
    if len(line) <= _WIDTH or "\n" in line or '"' in line or "/*" in line:
        return [line]
    margin = " " * (len(line) - len(line.lstrip()))
    return textwrap.wrap(
        line, _WIDTH, subsequent_indent=f"{margin}    ", break_long_words=False, break_on_hyphens=False
    )


# --- support ------------------------------------------------------------------------------------------


@cache
def definitions() -> dict[str, str]:
    """Return the definitions of support.c by name, dependencies first."""
    text = (Path(__file__).parent / "support.c").read_text(encoding="utf-8")
    parts = re.findall(
        r"^/\*(?:[^*]|\*(?!/))*\*/\n(?:static|struct).*?^\};?\n", text, re.MULTILINE | re.DOTALL
    )
    names = (re.search(r"(colony_\w+)(?:\(| \{\n)", part) for part in parts)
    return {name[1]: part for name, part in zip(names, parts, strict=True) if name is not None}


def _guard(name: str) -> str:
    return f"COLONY_{name.upper()}_H"  # no module has this constant


def preprocessor_lines(name: str) -> tuple[list[str], list[str]]:
    """Return the lines for the preprocessor in the header and source of a program."""
    types = [line for line in TYPES_TEXT.splitlines() if line.startswith("#")]
    guard = _guard(name)
    header = [f"#ifndef {guard}", f"#define {guard}", *_INCLUDES, *types, "#endif"]
    guards = [line for line in GUARDS.splitlines() if line.startswith("#")]
    return header, [f'#include "{name}.h"', "#include <float.h>", "#include <math.h>", *guards]


def support(words: set[str]) -> list[str]:
    """Return the definitions that these words need, dependencies first."""
    known = definitions()
    needed, pending = set[str](), list(words)
    while pending:
        name = pending.pop()
        if name in known and name not in needed:
            needed.add(name)
            pending.extend(re.findall(r"\w+", known[name]))
    return [definition for name, definition in known.items() if name in needed]
