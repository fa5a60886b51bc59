"""Checking of modules: written in the language, derived from others, or written in Python."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from typing import TypeVar

from colony.dsl import ast
from colony.dsl.check.checker import Checker, reject_private_member, type_hint
from colony.dsl.check.compatibility import fits, with_article
from colony.dsl.check.declare import ModuleNode
from colony.dsl.check.expressions import ExpressionChecker
from colony.dsl.check.functions import declare_function
from colony.dsl.check.inputs import (
    InputBinding,
    Inputs,
    both,
    check_inputs,
    check_let,
    check_nexts,
    check_param,
    check_state,
    input_readings,
    let_symbol,
    with_value,
)
from colony.dsl.check.references import actuator_named, resolve_network_symbol, resolve_reference
from colony.dsl.check.robot import command_arguments
from colony.dsl.check.scope import (
    BrokenSymbol,
    CheckReport,
    FileScope,
    ModuleSymbol,
    ParamSymbol,
    StateSymbol,
    TunableSymbol,
    ValueSymbol,
    label,
    span_of,
)
from colony.dsl.check.site_values import outside_text, site_param
from colony.ir import program as ir
from colony.ir.expression import Constant, Expression
from colony.ir.types import BOOL, DIMENSIONLESS, Enum, ScalarValue, type_text
from colony.record import Record, record
from colony.text.diagnostics import Diagnostic, has_errors

_Clause = TypeVar("_Clause", bound=ast.Clause | ast.PythonClause)
_DECLARING = (ast.InputDecl, ast.ParamDecl, ast.LetDecl, ast.FunctionDecl, ast.StateDecl)
_PYTHON_PATH = re.compile(r"[A-Za-z_]\w*(\.[A-Za-z_]\w*)*:[A-Za-z_]\w*")


@record
class Template(Record):
    """A module's declaration, its scope, and the params and inputs that derived modules give.

    `failsafe` is true if the module, or one that it is derived from, is declared so. `owner` is the full name
    of the module whose declaration it is. `is_valid` is False if an argument was refused: inputs may be
    unbound for that reason.
    """

    owner: str
    node: ast.ModuleDecl | ast.PythonModuleDecl
    failsafe: bool
    scope: FileScope
    params: Mapping[str, ParamSymbol]
    inputs: Mapping[str, InputBinding]
    is_valid: bool = True


@record
class CheckedModules(Record):
    """The modules of a program, and the lets that their inputs are.

    `templates` are the modules with inputs that are not bound; they are not part of the program.
    """

    modules: tuple[ir.AnyModule, ...]
    input_lets: tuple[ir.Let, ...]
    templates: frozenset[str]


@record
class Instance(Record):
    """A module, None if it is wrong or only a template, its inputs, and its names as written."""

    module: ir.AnyModule | None
    inputs: Inputs
    members: dict[str, ValueSymbol]


@record
class PendingModule(Record):
    """A module declaration that is still to be checked, with the scope of its file."""

    node: ModuleNode
    scope: FileScope

    @property
    def full_name(self) -> str:
        """Return the module's name in the program."""
        return self.scope.full_name(self.node.name.text)


def check_modules(report: CheckReport, declared: list[PendingModule]) -> CheckedModules:
    """Check all modules of a program, in order, and store their symbols in the scopes of their files.

    Each scope already holds a placeholder symbol for each of its modules, with its full name.
    """
    by_name = {p.full_name: p for p in declared}
    templates: dict[str, Template | None] = {}
    modules: list[ir.AnyModule] = []
    input_lets: list[ir.Let] = []
    template_names = set[str]()
    for pending in declared:
        template = _template(report, pending, by_name, templates)
        if template is None:
            continue
        instance = _instance(report, pending, template)
        module, unbound = instance.module, instance.inputs.unbound
        if module is None or (unbound and not template.is_valid):
            continue
        if unbound:
            template_names.add(module.name)
        else:
            modules.append(module)
            input_lets += instance.inputs.lets
        pending.scope.network_symbols[pending.node.name.text] = ModuleSymbol(
            name=module.name,
            actuator=module.actuator,
            members=instance.members,
            unbound=unbound,
            home=template.scope,
            derivation=_derivation(pending.node),
            span=span_of(pending.scope, pending.node),
        )
    checked = {m.name for m in modules} | template_names
    for pending in declared:
        if pending.full_name not in checked:
            pending.scope.network_symbols[pending.node.name.text] = BrokenSymbol()
    return CheckedModules(
        modules=tuple(modules), input_lets=tuple(input_lets), templates=frozenset(template_names)
    )


def _derivation(node: ModuleNode) -> str | None:
    """Return the declaration of a derived module up to further arguments, with `...` for those it has."""
    if not isinstance(node, ast.DerivedModuleDecl):
        return None
    given = "..., " if node.arguments else ""
    head = f"module {node.name.text}" if node.phase is None else node.name.text.rpartition(".")[2]
    return f"{head} = {node.base.text}({given}"


# --- derived modules -------------------------------------------------------------------------------


def _template(
    report: CheckReport,
    pending: PendingModule,
    by_name: Mapping[str, PendingModule],
    templates: dict[str, Template | None],
) -> Template | None:
    """Follow `module a = b(...)` to a module with a body, without recursion, as chains may be long."""
    chain: list[PendingModule] = []
    position: dict[str, int] = {}
    current: PendingModule | None = pending
    while current is not None and current.full_name not in templates:
        if current.full_name in position:
            cycle = [f"`{p.node.name.text}`" for p in [*chain[position[current.full_name] :], current]]
            names = " = ".join(cycle if len(cycle) <= 6 else [*cycle[:4], "...", cycle[-1]])
            report.error(
                current.scope, "E404", current.node.name, f"the module is derived from itself: {names}"
            )
            for p in chain:
                templates[p.full_name] = None
            return None
        position[current.full_name] = len(chain)
        chain.append(current)
        if not isinstance(current.node, ast.DerivedModuleDecl):
            node, scope = current.node, current.scope
            templates[current.full_name] = Template(
                owner=current.full_name,
                node=node,
                failsafe=node.failsafe,
                scope=scope,
                params={},
                inputs={},
            )
            break
        current = _base(report, current, by_name)
        if current is None:
            for p in chain:
                templates[p.full_name] = None
    for p in reversed(chain):
        if isinstance(p.node, ast.DerivedModuleDecl) and p.full_name not in templates:
            base = _base(report, p, by_name, quiet=True)
            template = templates[base.full_name] if base else None
            templates[p.full_name] = None if template is None else _derive(report, p, p.node, template)
    return templates[pending.full_name]


def _base(
    report: CheckReport, pending: PendingModule, by_name: Mapping[str, PendingModule], quiet: bool = False
) -> PendingModule | None:
    """Return the declaration that a derived module names as its base."""
    assert isinstance(pending.node, ast.DerivedModuleDecl)
    scope, path = pending.scope.resolve_part(pending.node.base.path)
    symbol = scope.network_symbol(path[0]) if len(path) == 1 else None
    if isinstance(symbol, ModuleSymbol) and symbol.name in by_name:
        base = by_name[symbol.name]
        if not (isinstance(base.node, ast.DerivedModuleDecl) and base.node.phase is not None):
            return base
        if not quiet:
            task, written = pending.node.base.text, base.node.base.text
            hint = f"derive from `{written}`" if written != task else "derive from an ordinary module"
            message = f"`{task}` is a task, and applies only in its phase: nothing can be derived from it"
            checker = ExpressionChecker(scope=pending.scope, report=report)
            checker.error("E404", pending.node.base, message, hint)
        return None
    if quiet:
        return None
    if symbol is None or isinstance(symbol, ModuleSymbol):
        resolve_network_symbol(ExpressionChecker(scope=pending.scope, report=report), pending.node.base)
    elif not isinstance(symbol, BrokenSymbol):
        report.error(pending.scope, "E404", pending.node.base, f"`{pending.node.base.text}` is not a module")
    return None


def _derive(
    report: CheckReport, pending: PendingModule, node: ast.DerivedModuleDecl, base: Template
) -> Template:
    checker = ExpressionChecker(scope=pending.scope, report=report)
    known = [c.name.text for c in base.node.clauses if isinstance(c, ast.ParamDecl)]
    known_inputs = [c.name.text for c in base.node.clauses if isinstance(c, ast.InputDecl)]
    declared: dict[str, ValueSymbol] = {}
    quiet = ExpressionChecker(scope=base.scope, report=CheckReport(), local=declared)
    _params(quiet, base, base.owner, declared)
    params, inputs = dict(base.params), dict(base.inputs)
    given: set[str] = set()
    is_valid = base.is_valid
    for argument in node.arguments:
        name = argument.name.text
        if reject_private_member(checker, argument.name, base.scope, name):
            is_valid = False
            continue
        if name not in known and name not in known_inputs:
            _report_unknown_argument(checker, node, argument.name, known, known_inputs)
            is_valid = False
            continue
        if name in given:
            what = f"param `{name}` is set" if name in known else f"input `{name}` is bound"
            checker.error("E404", argument.name, f"{what} twice")
        given.add(name)
        if name in known_inputs:
            inputs[name] = InputBinding(name=argument.name, value=argument.value, scope=pending.scope)
            continue
        param = declared.get(name)
        found = checker.constant(argument.value, None, f"param `{name}`", _computed_param(name, param))
        if found is None or not isinstance(param, ParamSymbol):
            continue
        outside = outside_text(param, found.value) if isinstance(param, TunableSymbol) else None
        if outside is not None and fits(found.type, param.type):
            checker.error("E404", argument.value, f"param `{name}` is {outside}")
        elif fits(found.type, param.type):
            params[name] = ParamSymbol(type=param.type, value=found.value)
        else:
            expected = f"param `{name}` of `{node.base.text}` is {with_article(param.type)}"
            hint = type_hint(argument.value, found.type, param.type)
            checker.error("E404", argument.value, f"{expected}, found {with_article(found.type)}", hint)
    for name in known:
        site_value = pending.scope.site.get(f"{pending.full_name}.{name}")
        param = declared.get(name)
        if site_value is not None and isinstance(param, ParamSymbol):
            set_param = site_param(checker, site_value, param, node.name)
            params |= {name: set_param} if isinstance(set_param, ParamSymbol) else {}
    failsafe = base.failsafe or node.failsafe
    return replace(base, params=params, inputs=inputs, failsafe=failsafe, is_valid=is_valid)


def _computed_param(name: str, param: ValueSymbol | None) -> str | None:
    """Return a hint for a param that is given a value that is no constant."""
    if not isinstance(param, ParamSymbol) or isinstance(param.type, Enum):
        return None
    type_ = {BOOL: "bool", DIMENSIONLESS: "number"}.get(param.type, type_text(param.type))
    return f"a param is constant; for a value that is computed, declare it as `input {name} : {type_}`"


def _report_unknown_argument(
    checker: Checker, node: ast.DerivedModuleDecl, name: ast.NameNode, params: list[str], inputs: list[str]
) -> None:
    shown = [f"its {kind} are {', '.join(names)}" for kind, names in _kinds(params, inputs) if names]
    similar = checker.report.suggest(name.text, [*params, *inputs])
    kinds = "param or input" if inputs else "param"
    hint = similar or "; ".join(shown) or "it has no params"
    checker.error("E404", name, f"`{node.base.text}` has no {kinds} `{name.text}`", hint)


def _kinds(params: list[str], inputs: list[str]) -> tuple[tuple[str, list[str]], ...]:
    return (("inputs", inputs), ("params", params))


# --- instances -------------------------------------------------------------------------------------


def _instance(report: CheckReport, pending: PendingModule, template: Template) -> Instance:
    """Return the module; the body of a template is checked, too."""
    derived = isinstance(pending.node, ast.DerivedModuleDecl)
    local: dict[str, ValueSymbol] = {}
    cells, budget = report.cells, report.size.budget
    # A derived module repeats the errors of its base, which are reported already.
    derived_report = replace(report, diagnostics=[]) if derived else report
    checker = ExpressionChecker(scope=template.scope, report=derived_report, local=local)
    before = len(derived_report.diagnostics)
    clauses = _clauses(template.node, ast.InputDecl)
    inputs = check_inputs(checker, report, pending.full_name, clauses, template.inputs)
    derived_report.cells = report.cells  # bindings may have memory
    module: ir.AnyModule | None
    if isinstance(template.node, ast.PythonModuleDecl):
        module = _python_module(checker, pending, template.node, template, local)
    else:
        module = _module(checker, pending, template.node, template, local)
    if module is not None:
        module = replace(module, failsafe=template.failsafe)
        if isinstance(pending.node, ast.DerivedModuleDecl) and pending.node.phase is not None:
            module = _in_phase(report, pending, pending.node.phase, module)
    if derived:
        report.cells = derived_report.cells
        _report_misfits(report, pending, derived_report)
    if inputs.unbound:
        report.cells = cells  # what a template reads is no part of the program
        report.size.refund(budget)
        if module is None and not has_errors(derived_report.diagnostics[before:]):
            module = _stand_in(pending)
    return Instance(module=module if inputs.are_valid else None, inputs=inputs, members=local)


def _in_phase(
    report: CheckReport, pending: PendingModule, phase: ast.Expression, module: ir.AnyModule
) -> ir.AnyModule:
    """Return the module of a task, which applies only in its phase; its memory advances in all phases."""
    present = ExpressionChecker(scope=pending.scope, report=report).check(phase)
    if present is None or not isinstance(module, ir.Module):
        return module  # which was reported
    when = both(present, module.when)
    assert when is not None
    return replace(module, when=replace(when, span=module.when.span))


def _stand_in(pending: PendingModule) -> ir.Module:
    """Return a module for a template that cannot be checked in full before its inputs are bound."""
    span = span_of(pending.scope, pending.node.name)
    return ir.Module(name=pending.full_name, span=span, when=Constant(type=BOOL, value=True))


def _report_misfits(report: CheckReport, pending: PendingModule, derived_report: CheckReport) -> None:
    """Report errors in the text of the base module that these params and inputs cause."""
    errors = [d for d in derived_report.diagnostics if d.severity == "error"]
    known = {_identity(d) for d in report.diagnostics} if errors else set()
    derivation = label(pending.scope, pending.node, "derived here")
    report.diagnostics += [
        replace(d, labels=(*d.labels, derivation)) for d in errors if _identity(d) not in known
    ]


def _identity(d: Diagnostic) -> tuple[object, ...]:
    return d.code, id(d.span.source), d.span.start, d.message


def _clauses(node: ast.ModuleDecl | ast.PythonModuleDecl, kind: type[_Clause]) -> list[_Clause]:
    return [c for c in node.clauses if isinstance(c, kind)]


def _module(
    checker: Checker,
    pending: PendingModule,
    node: ast.ModuleDecl,
    template: Template,
    local: dict[str, ValueSymbol],
) -> ir.Module | None:
    """Check a module written in the language; return None if anything in it is wrong."""
    full_name, before = pending.full_name, len(checker.report.diagnostics)
    names = frozenset(c.name.text for c in node.clauses if not isinstance(c, ast.NextDecl))
    checker = replace(checker, module_names=names)
    _report_duplicates(checker, node.clauses)
    params = _params(checker, template, full_name, local)
    states = _states(checker, full_name, _clauses(node, ast.StateDecl), local)
    lets: list[ir.Let] = []
    for clause in node.clauses:
        if isinstance(clause, ast.FunctionDecl):
            local[clause.name.text] = declare_function(checker, clause, local)
        elif isinstance(clause, ast.LetDecl):
            let = check_let(checker, clause, f"{full_name}.{clause.name.text}")
            local[clause.name.text] = BrokenSymbol() if let is None else let_symbol(let, full_name)
            lets += [let] if let else []
    state_symbols = {c.name.text: local[c.name.text] for c in _clauses(node, ast.StateDecl)}
    nexts = check_nexts(checker, _clauses(node, ast.NextDecl), state_symbols)
    when = checker.expect(node.when, BOOL, "the predicate after `when`")
    command = None if node.do is None else _command(checker, node.do)
    if node.do is not None and command is None:
        return None
    if when is None or any(d.severity == "error" for d in checker.report.diagnostics[before:]):
        return None
    return ir.Module(
        name=full_name,
        span=span_of(pending.scope, pending.node.name),
        params=params,
        lets=tuple(lets),
        states=tuple(replace(s, next=nexts.get(s.name.removeprefix(f"{full_name}."))) for s in states),
        when=when,
        command=command,
    )


def _report_duplicates(checker: Checker, clauses: tuple[ast.Clause | ast.PythonClause, ...]) -> None:
    names: dict[str, ast.NameNode] = {}
    for clause in clauses:
        if isinstance(clause, _DECLARING):
            first = names.setdefault(clause.name.text, clause.name)
            if first is not clause.name:
                message = f"`{clause.name.text}` is declared twice in the module"
                checker.error("E102", clause.name, message, None, checker.label(first))


def _params(
    checker: Checker, template: Template, module: str, local: dict[str, ValueSymbol]
) -> tuple[tuple[str, ScalarValue], ...]:
    """Return the constant params in order, as written or overridden; each may read those above it.

    Tunable ones are named after `module`, the full name of the module that has them.
    """
    params: list[tuple[str, ScalarValue]] = []
    for clause in _clauses(template.node, ast.ParamDecl):
        name = clause.name.text
        symbol: ParamSymbol | BrokenSymbol = check_param(checker, clause, f"{template.owner}.{name}")
        given = template.params.get(name, symbol)
        if isinstance(symbol, TunableSymbol) and isinstance(given, ParamSymbol):
            local[name] = with_value(symbol, given.value, f"{module}.{name}")
            continue
        local[name] = symbol = given
        if isinstance(symbol, ParamSymbol):
            params.append((name, symbol.value))  # type: ignore[arg-type]
    return tuple(params)


def _states(
    checker: Checker, full_name: str, clauses: list[ast.StateDecl], local: dict[str, ValueSymbol]
) -> list[ir.State]:
    """Return the states, without their next values."""
    states: list[ir.State] = []
    for clause in clauses:
        name = clause.name.text
        found = check_state(checker, clause)
        if found is None:
            local[name] = BrokenSymbol()
            continue
        type_, initial = found
        local[name] = StateSymbol(name=f"{full_name}.{name}", type=type_)
        span = checker.span(clause.name)
        states.append(ir.State(name=f"{full_name}.{name}", type=type_, initial=initial, next=None, span=span))
    return states


def _command(checker: Checker, node: ast.DoDecl) -> ir.TransferFunction | None:
    """Check the command, and return its fields in the order of the actuator's."""
    actuator = actuator_named(checker, node.actuator)
    if actuator is None:
        for argument in node.arguments:
            checker.check(argument.value)
        return None
    names = [f.name for f in actuator.fields]
    optional = {f.name for f in actuator.fields if f.default is not None}
    values = command_arguments(checker, node, node.arguments, names, actuator.name, optional)
    fields: list[Expression] = []
    for field in actuator.fields:
        if field.name in values:
            found = checker.expect(values[field.name].value, field.type, f"field `{field.name}`")
            fields += [found] if found else []
        elif field.default is not None:
            fields.append(Constant(type=field.type, value=field.default, span=checker.span(node)))
    return (
        ir.TransferFunction(actuator=actuator.name, fields=tuple(fields))
        if len(fields) == len(names)
        else None
    )


# --- Python modules --------------------------------------------------------------------------------


def _python_module(
    checker: Checker,
    pending: PendingModule,
    node: ast.PythonModuleDecl,
    template: Template,
    local: dict[str, ValueSymbol],
) -> ir.PythonModule | None:
    """Check a module whose step is Python. Its class is not imported: checking runs no user code."""
    before = len(checker.report.diagnostics)
    _report_duplicates(checker, node.clauses)
    params = _params(checker, template, pending.full_name, local)
    for clause in _clauses(node, ast.ParamDecl):
        if isinstance(local.get(clause.name.text), TunableSymbol):
            message = "the class of a module in Python is built once, with its params"
            hint = f"declare `input {clause.name.text} : TYPE`, and bind a tunable param to it"
            checker.error("E406", clause, message, hint)
    if not _PYTHON_PATH.fullmatch(node.path):
        hint = 'for example "center_hallway:CenterHallway"'
        checker.error("E405", node, f'"{node.path}" does not name a class as "package.module:Class"', hint)
    commands, rates = _clauses(node, ast.CommandsDecl), _clauses(node, ast.RateDecl)
    for extra in [*commands[1:], *rates[1:]]:
        word = "commands" if isinstance(extra, ast.CommandsDecl) else "rate"
        checker.error("E406", extra, f"`{word}` is given twice")
    reads = [r for clause in _clauses(node, ast.ReadsDecl) for r in clause.names]
    readings = [_reading(checker, r) for r in reads]
    input_values = input_readings(checker, _clauses(node, ast.InputDecl), reads)
    actuator = actuator_named(checker, commands[0].actuator) if commands else None
    rate = checker.duration_ns(rates[0].period, "the rate") if rates else None
    if rate == 0:
        checker.error("E406", rates[0], "the rate must be longer than 0", "leave it out for every frame")
    if any(d.severity == "error" for d in checker.report.diagnostics[before:]):
        return None
    if commands and actuator is None:
        return None
    module_path, _, class_name = node.path.partition(":")
    return ir.PythonModule(
        name=pending.full_name,
        span=span_of(pending.scope, pending.node.name),
        module_path=module_path,
        class_name=class_name,
        params=params,
        reads=(
            *(
                ir.PythonReading(name=node.text, expression=found)
                for node, found in zip(reads, readings, strict=True)
                if found is not None
            ),
            *input_values,
        ),
        actuator=actuator.name if actuator else None,
        rate_ns=rate,
    )


def _reading(checker: Checker, node: ast.Reference) -> Expression | None:
    """Check a sensor, let, state or machine that a Python module reads."""
    found = resolve_reference(replace(checker, local={}), node)
    if isinstance(found, Constant):
        hint = "give constants to it as params"
        checker.error("E406", node, f"`{node.text}` is a constant, so it is not read in each frame", hint)
        return None
    return found
