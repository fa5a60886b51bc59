"""Resolution of references: `name`, `name.name`, `actuator by module` and `name is active`."""

from __future__ import annotations

from dataclasses import replace
from itertools import islice

from colony.dsl import ast
from colony.dsl.check.arrays import MAX_ITERATIONS
from colony.dsl.check.calls import FUNCTION_NAMES
from colony.dsl.check.checker import (
    CONSTANT_HINT,
    Checker,
    reject_private_member,
    reject_private_name,
    sent_field,
)
from colony.dsl.check.compatibility import placeholder, with_new_cells
from colony.dsl.check.declare import RESTARTED
from colony.dsl.check.scope import (
    ActuatorSymbol,
    ArgumentSymbol,
    AssumptionSymbol,
    BrokenSymbol,
    EnumSymbol,
    FileScope,
    FunctionSymbol,
    LetSymbol,
    MachineSymbol,
    ModuleSymbol,
    NetworkSymbol,
    ParamSymbol,
    PlaceholderSymbol,
    SensorSymbol,
    SequenceSymbol,
    StateSymbol,
    TunableSymbol,
    ValueSymbol,
    WireSymbol,
)
from colony.ir import expression as ir
from colony.ir import program as program_ir
from colony.ir.types import BOOL, DURATION, Enum
from colony.text.diagnostics import Label
from colony.text.wording import Remedy, quoted


def resolve_reference(checker: Checker, node: ast.Reference) -> ir.Expression | None:
    """Return the typed expression that a name refers to, or None after reporting an error."""
    head = node.path[0]
    if head == program_ir.SENT:
        return _sent_before(checker, node)
    if len(node.path) == 1:
        if head in checker.loops:
            return replace(checker.loops[head], span=checker.span(node))
        symbol = checker.local.get(head) or checker.scope.value(head)
        if symbol is not None:
            return _value(checker, node, symbol)
        if head == "now":  # `now` is `now()`, unless something else has that name
            return ir.Now(type=DURATION, span=checker.span(node))
        if head == "frame_period":  # likewise
            return _frame_period(checker, node)
        if head == RESTARTED:
            return ir.RestartedFlag(type=BOOL, span=checker.span(node))
        _unknown(checker, node, checker.scope, head)
        return None
    if head in checker.local:
        return _member(checker, node, checker.local[head], node.path[1:])
    scope, path = checker.scope.resolve(node.path)
    symbol, part = scope.value(path[0]), _part_with_members(scope, path)
    if symbol is not None and len(path) == 1:
        return _value(checker, node, symbol)
    if isinstance(symbol, BrokenSymbol):
        return None
    is_value = isinstance(symbol, EnumSymbol | MachineSymbol) and len(path) == 2
    if part is not None and not (is_value and not _is_network_member(checker, symbol, part, path[1])):
        return _network_member(checker, node, part, path[-1])
    if symbol is not None:
        return _member(checker, node, symbol, path[1:])
    _unknown(checker, node, scope, path[0])
    return None


def _part_with_members(scope: FileScope, path: tuple[str, ...]) -> NetworkSymbol | None:
    """Return the module, wire or actuator of `part.member` or, in a sequence, of `sequence.part.member`."""
    if len(path) == 3 and isinstance(scope.network_symbol(path[0]), SequenceSymbol):
        return scope.network_symbol(".".join(path[:2]))
    return scope.network_symbol(path[0]) if len(path) == 2 else None


def _sent_before(checker: Checker, node: ast.Reference) -> ir.Expression | None:
    """Return the typed expression `last.ACTUATOR.FIELD`, or None after reporting an error."""
    if checker.constants_only:
        checker.error("E204", node, f"`{node.text}` is not constant", CONSTANT_HINT)
        return None
    sensor = sent_field(checker, node)
    if sensor is None:
        return None
    return ir.SensorValue(type=sensor.type, name=sensor.name, span=checker.span(node))


def _frame_period(checker: Checker, node: ast.Reference) -> ir.Expression | None:
    """Return the robot's frame period, a constant, or None after reporting an error."""
    frame_ns = checker.scope.robot.frame_ns
    if frame_ns is None:
        if not checker.scope.may_be_lost("frame_period"):
            message = "`frame_period` is not known yet: the frame period itself is computed from params"
            checker.error("E105", node, message, "write the frame period as a number: `frame 50 ms`")
        return None
    return ir.Constant(type=DURATION, value=frame_ns / 1e9, span=checker.span(node))


def _value(checker: Checker, node: ast.Reference, symbol: ValueSymbol) -> ir.Expression | None:
    span = checker.span(node)
    match symbol:
        case SensorSymbol(sensor=sensor):
            return ir.SensorValue(type=sensor.type, name=sensor.name, span=span)
        case TunableSymbol(sensor=sensor):
            if checker.constants_only:
                message = f"`{node.text}` is tunable, so it is not constant"
                checker.error("E204", node, message, "name what is computed from it with `let`")
                return None
            checker.scope.robot.tunables[sensor.name] = sensor
            return ir.SensorValue(type=sensor.type, name=sensor.name, span=span)
        case ParamSymbol(type=type_, value=value):
            return ir.Constant(type=type_, value=value, span=span)
        case LetSymbol(name=name, type=type_, module=None):
            return ir.DerivedValue(type=type_, name=name, span=span)
        case LetSymbol(name=name, type=type_):
            return ir.LocalValue(type=type_, name=name, span=span)
        case StateSymbol(name=name, type=type_) | MachineSymbol(name=name, type=type_):
            return ir.StateValue(type=type_, name=name, span=span)
        case PlaceholderSymbol(type=type_):
            return placeholder(type_, span)
        case ArgumentSymbol():
            return _argument(checker, node, symbol)
        case FunctionSymbol(parameters=parameters):
            call = f"{node.text}({', '.join(p.name for p in parameters)})"
            checker.error("E106", node, f"`{node.text}` is a function, not a value", f"call it: `{call}`")
            return None
        case AssumptionSymbol():
            message = f"`{node.text}` is an assumption, not a value"
            checker.error(
                "E106",
                node,
                message,
                Remedy(f"ask whether it is broken: `broken({node.text})`", node.text, f"broken({node.text})"),
            )
            return None
        case EnumSymbol(type=enum):
            example = f"{node.text}.{enum.members[0][0]}"
            checker.error(
                "E106", node, f"`{node.text}` is an enum, not a value", f"name a member: `{example}`"
            )
            return None
        case BrokenSymbol():
            return None


def _argument(checker: Checker, node: ast.Reference, symbol: ArgumentSymbol) -> ir.Expression | None:
    """Return the argument that a parameter stands for, with memory of its own."""
    iterations = checker.iterations * symbol.iterations
    if iterations > MAX_ITERATIONS:
        message = f"{iterations} iterations with what `{node.text}` stands for; "
        checker.error("E211", node, f"{message}at most {MAX_ITERATIONS} are allowed")
        return None
    if not checker.report.size.add_argument(symbol.nodes, symbol.depth):
        return None
    if symbol.has_memory:
        return with_new_cells(symbol.expression, checker.report.new_cell)
    return symbol.expression


def _member(
    checker: Checker, node: ast.Reference, symbol: ValueSymbol, member_path: tuple[str, ...]
) -> ir.Expression | None:
    """Resolve `enum.member` or `machine.phase`."""
    owner = ".".join(node.path[: len(node.path) - len(member_path)])
    match symbol:
        case EnumSymbol(type=enum) | MachineSymbol(type=enum) if len(member_path) == 1:
            value = dict(enum.members).get(member_path[0])
            if value is not None:
                return ir.Constant(type=enum, value=value, span=checker.span(node))
            names = [name for name, _ in enum.members]
            hint = checker.report.suggest(member_path[0], names) or f"it has {', '.join(names)}"
            checker.error("E108", node, f"`{owner}` has no {_member_word(enum)} `{member_path[0]}`", hint)
        case BrokenSymbol():
            pass
        case _:
            checker.error("E108", node, f"`{owner}` has no member `{'.'.join(member_path)}`")
    return None


def _member_word(enum: Enum) -> str:
    return "phase" if enum.kind == "machine" else "member"


def _is_network_member(
    checker: Checker, symbol: ValueSymbol | None, network_symbol: NetworkSymbol, name: str
) -> bool:
    """Return True if `owner.name` is a member of a module or actuator, although `owner` is also a value."""
    is_known = isinstance(symbol, EnumSymbol | MachineSymbol) and name in dict(symbol.type.members)
    if is_known or not checker.in_contract_or_test:
        return False
    match network_symbol:
        case ActuatorSymbol(actuator=actuator):
            return name in [field.name for field in actuator.fields]
        case ModuleSymbol(members=members):
            return name in members
        case _:
            return False


def _network_member(
    checker: Checker, node: ast.Reference, network_symbol: NetworkSymbol, name: str
) -> ir.Expression | None:
    """Resolve `actuator.field` or `module.name`, in contracts and tests."""
    if isinstance(network_symbol, BrokenSymbol):
        return None
    if not checker.in_contract_or_test:
        hint = "a module cannot read other modules; share values through file-level `let` and `state`"
        checker.error("E106", node, f"`{node.text}` can be read only in contracts and tests", hint)
        return None
    owner = ".".join(node.path[:-1])
    match network_symbol:
        case ActuatorSymbol(actuator=actuator):
            for index, field in enumerate(actuator.fields):
                if field.name == name:
                    span = checker.span(node)
                    return ir.SentField(type=field.type, actuator=actuator.name, field_index=index, span=span)
            suggestion = checker.report.suggest(name, [f.name for f in actuator.fields])
            checker.error("E108", node, f"actuator `{owner}` has no field `{name}`", suggestion)
        case ModuleSymbol(members=members, home=home):
            if reject_private_member(checker, node, home, name):
                return None
            if network_symbol.unbound:
                _report_unbound(checker, node, owner, network_symbol)
                return None
            if name in members:
                return _value(checker, node, members[name])
            hint = (
                checker.report.suggest(name, members)
                or "a contract can read the module's params, inputs, lets and states"
            )
            checker.error("E108", node, f"module `{owner}` has no `{name}`", hint)
        case WireSymbol() | SequenceSymbol():
            checker.error("E108", node, f"`{owner}` is {kind_of_part(network_symbol)} and has no `{name}`")
    return None


def _unknown(checker: Checker, node: ast.Reference, scope: FileScope, name: str) -> None:
    """Report an unknown name, and suggest the closest known one."""
    network_symbol = scope.network_symbol(name)
    if isinstance(network_symbol, BrokenSymbol):
        return
    if network_symbol is not None:
        status = "commanded" if isinstance(network_symbol, ActuatorSymbol) else "active"
        status_hint = (
            Remedy(f"write `{name} is {status}`", name, f"{name} is {status}")
            if checker.in_contract_or_test
            else "only contracts and tests can refer to it"
        )
        checker.error("E106", node, f"`{name}` is {kind_of_part(network_symbol)}, not a value", status_hint)
        return
    if reject_private_name(checker, node, scope, name):
        return
    if checker.constants_only and _declared_but_not_constant(scope, name):
        checker.error("E204", node, f"`{name}` is not constant", CONSTANT_HINT)
        return
    if name in scope.visible_values or name in checker.module_names:
        checker.error("E105", node, f"`{name}` is used before it is declared", _DECLARE_ABOVE)
        return
    known_names = [*checker.local, *scope.visible_values, *scope.robot.values, *scope.aliases, *checker.loops]
    robot = checker.scope.robot
    if name in robot.sensor_names | robot.actuator_names:
        prefixed = Remedy(f"the robot's names are never prefixed: write `{name}`", node.text, name)
        checker.error("E101", node, f"unknown name `{node.text}`", prefixed)
        return
    hint = _WORD_HINTS.get(name) or _member_hint(scope, name) or checker.report.suggest(name, known_names)
    report_unknown(checker, "E101", node, f"unknown name `{name}`", hint)


def report_unknown(checker: Checker, code: str, node: ast.Reference, message: str, hint: str | None) -> None:
    """Report an unknown name; in files with `import robot` once, with the robot that may lack it."""
    robot = checker.scope.robot
    if not robot.title or not checker.scope.is_for_any_robot:
        checker.error(code, node, message, hint)
    elif node.text not in robot.lacks:
        robot.lacks.add(node.text)
        lacks = f"{robot.title} has none, neither sensor nor `let`"
        both = f"{lacks}; {hint}" if hint else lacks
        remedy = Remedy(both, hint.found, *hint.written) if isinstance(hint, Remedy) else both
        checker.error(code, node, message, remedy)


_DECLARE_ABOVE = "declare it above the line that reads it"
_WORD_HINTS = {
    "True": Remedy("write `true`", "True", "true"),
    "False": Remedy("write `false`", "False", "false"),
    "None": "write `missing` in tests, `fresh(sensor)` in expressions",
    "t": "the time since the first frame is `now`",
    "time": "the time since the first frame is `now`",
    "pi": "angles have units: `180 deg`, `3.14 rad`",
    **{name: f"it is a function: `{name}(...)`" for name in FUNCTION_NAMES},
}


def _member_hint(scope: FileScope, name: str) -> str | None:
    """Return a hint that names the enum or machine with this member."""
    for owner, symbol in islice(scope.values.items(), 1000):
        if isinstance(symbol, EnumSymbol | MachineSymbol) and name in dict(symbol.type.members):
            return Remedy(f"did you mean `{owner}.{name}`?", name, f"{owner}.{name}")
    return None


def _declared_but_not_constant(scope: FileScope, name: str) -> bool:
    owner = scope.visible_values.get(name)
    return name in scope.robot.sensor_names if owner is None else name not in owner.constant_names


def kind_of_part(symbol: NetworkSymbol) -> str:
    """Return the kind of a part of the network with its article, for messages."""
    match symbol:
        case ActuatorSymbol():
            return "an actuator"
        case WireSymbol():
            return "a wire"
        case SequenceSymbol():
            return "a sequence"
        case _:
            return "a module"


# --- `by` and `is` in contracts ------------------------------------------------------------------


def resolve_winner(checker: Checker, node: ast.By) -> ir.Expression | None:
    """Resolve `actuator by module`, also of the frame before."""
    if is_before(node):
        return _read_role(checker, node)
    if not _check_in_contract_or_test(checker, node):
        return None
    actuator, module = network_symbol_of(checker, node.actuator), network_symbol_of(checker, node.module)
    if actuator is not None and not isinstance(actuator, ActuatorSymbol | BrokenSymbol):
        checker.error("E202", node.actuator, "expected an actuator to the left of `by`")
        actuator = None
    if module is not None and not isinstance(module, ModuleSymbol | BrokenSymbol):
        checker.error("E202", node.module, "expected a module to the right of `by`")
        module = None
    if not isinstance(actuator, ActuatorSymbol) or not isinstance(module, ModuleSymbol):
        return None
    if not _commands(checker, node.module, module, actuator):
        return None
    span = checker.span(node)
    return ir.WonBy(type=BOOL, actuator=actuator.actuator.name, module=module.name, span=span)


def _commands(checker: Checker, node: ast.Expression, module: ModuleSymbol, actuator: ActuatorSymbol) -> bool:
    """Return True if a module commands an actuator; report an error if it does not."""
    if module.actuator == actuator.actuator.name:
        return True
    hint = f"it commands `{module.actuator}`" if module.actuator else "it commands nothing"
    checker.error("E202", node, f"`{module.name}` never commands `{actuator.actuator.name}`", hint)
    return False


def resolve_status(checker: Checker, node: ast.Is) -> ir.Expression | None:
    """Resolve `name is active`, also of the frame before, `actuator is commanded`, `actuator is idle`."""
    if is_before(node):
        return _read_role(checker, node)
    if not _check_in_contract_or_test(checker, node):
        return None
    network_symbol = network_symbol_of(checker, node.subject)
    span = checker.span(node)
    if network_symbol is None or isinstance(network_symbol, BrokenSymbol):
        return None
    if isinstance(network_symbol, ActuatorSymbol):
        if node.status == "active":
            hint = "use `is commanded` or `is idle`"
            checker.error("E202", node, f"`{network_symbol.actuator.name}` is an actuator", hint)
            return None
        kind = ir.IsIdle if node.status == "idle" else ir.IsCommanded
        return kind(type=BOOL, actuator=network_symbol.actuator.name, span=span)
    if node.status != "active":
        checker.error(
            "E202",
            node,
            f"`{network_symbol.name}` is not an actuator",
            "for modules and wires, use `is active`",
        )
        return None
    return ir.IsActive(type=BOOL, name=network_symbol.name, span=span)


# --- `by` and `is` of the frame before -----------------------------------------------------------
#
# They are sensors, which may be read before the module that they name is checked. So an expression reads them
# by name, and `role_sensor` checks what they name once all modules are known.


def is_before(node: ast.By | ast.Is) -> bool:
    """Return True for `last.ACTUATOR by MODULE` and `last.MODULE is active`."""
    subject = node.actuator if isinstance(node, ast.By) else node.subject
    return isinstance(subject, ast.Reference) and subject.path[0] == program_ir.SENT


def role_read(checker: Checker, node: ast.By | ast.Is) -> str | None:
    """Return the name of the sensor that `node` reads, or None after reporting an error of its form."""
    named = _names(node)
    if named is None:
        hint = "write `last.ACTUATOR by MODULE` or `last.MODULE is active`"
        checker.error("E202", node, "of the frame before, this cannot be read", hint)
        return None
    actuator, module = named
    scope, path = checker.scope.resolve_part(module.path)
    owner = scope.visible_network_symbols.get(path[0].partition(".")[0]) if len(path) == 1 else None
    full_name = module.text if owner is None else owner.full_name(path[0])
    name = program_ir.role_name("" if actuator is None else actuator.text, _role(node, full_name))
    checker.scope.robot.roles[checker.scope.file.key, name, node.start] = checker.scope, node
    return name


def role_sensor(checker: Checker, node: ast.By | ast.Is) -> program_ir.Sensor | None:
    """Return the sensor that `node` reads once all modules are checked, or None after reporting an error."""
    named = _names(node)
    assert named is not None, "its form was checked"
    name, module_node = named
    actuator = None if name is None else actuator_named(checker, name)
    module = resolve_network_symbol(checker, module_node)
    if module is None or isinstance(module, BrokenSymbol) or (name is not None and actuator is None):
        return None
    if not isinstance(module, ModuleSymbol):
        hint = "name a module" if isinstance(module, WireSymbol) else "read `last.ACTUATOR by MODULE`"
        checker.error("E202", module_node, f"expected a module, found {kind_of_part(module)}", hint)
        return None
    commanded = checker.scope.robot.network_symbols.get(module.actuator or "")
    if actuator is None and not isinstance(commanded, ActuatorSymbol):
        hint = "the server of an actuator knows only the modules that command it"
        checker.error("E202", module_node, f"`{module.name}` commands nothing", hint)
        return None
    symbol = commanded if actuator is None else ActuatorSymbol(actuator=actuator)
    assert isinstance(symbol, ActuatorSymbol)
    if not _commands(checker, module_node, module, symbol):
        return None
    return program_ir.role_sensor(symbol.actuator, _role(node, module.name))


def _names(node: ast.By | ast.Is) -> tuple[ast.NameNode | None, ast.Reference] | None:
    """Return the actuator, if any, and the module that `node` names; None if it has another form."""
    match node:
        case ast.By(actuator=ast.Reference(path=(_, name), end=end), module=ast.Reference() as module):
            return ast.NameNode(text=name, start=end - len(name), end=end), module
        case ast.Is(subject=ast.Reference(path=(_, *path), start=start, end=end), status="active") if path:
            # what a sequence writes out stands at the name of a task, which may be shorter
            return None, ast.Reference(path=tuple(path), start=max(start, end - len(path[-1])), end=end)
        case _:
            return None


def _role(node: ast.By | ast.Is, module: str) -> program_ir.Role:
    return program_ir.Role(kind="by" if isinstance(node, ast.By) else "active", module=module)


def _read_role(checker: Checker, node: ast.By | ast.Is) -> ir.Expression | None:
    if checker.constants_only:
        checker.error("E204", node, "what a module did in the frame before is not constant", CONSTANT_HINT)
        return None
    name = role_read(checker, node)
    return None if name is None else ir.SensorValue(type=BOOL, name=name, span=checker.span(node))


def _check_in_contract_or_test(checker: Checker, node: ast.SyntaxNode) -> bool:
    if not checker.in_contract_or_test:
        hint = "of the frame before, read `last.ACTUATOR by MODULE` or `last.MODULE is active`"
        checker.error("E210", node, "`by` and `is` are allowed only in contracts and tests", hint)
    return checker.in_contract_or_test


def network_symbol_of(checker: Checker, node: ast.Expression) -> NetworkSymbol | None:
    """Return the module, wire or actuator that an expression names, or None after an error."""
    if not isinstance(node, ast.Reference):
        checker.error("E202", node, "expected the name of a module, wire or actuator")
        return None
    return resolve_network_symbol(checker, node)


def resolve_network_symbol(checker: Checker, node: ast.Reference) -> NetworkSymbol | None:
    """Return the module, wire or actuator of this name, or None after an error."""
    scope, path = checker.scope.resolve_part(node.path)
    network_symbol: NetworkSymbol | None = None
    if len(path) == 1 and scope is not checker.scope:
        network_symbol = scope.actuator_wires.get(path[0])
    if len(path) == 1 and network_symbol is None:
        network_symbol = scope.network_symbol(path[0])
    if network_symbol is None and len(path) > 1 and scope.may_be_lost(path[0]):
        network_symbol = BrokenSymbol()
    if network_symbol is None and len(path) == 1 and scope.value(path[0]) is not None:
        message = f"`{node.text}` is a value, not a module, wire or actuator"
        hint = None if checker.in_contract_or_test else "a module reads values in `when` and `do`"
        checker.error("E106", node, message, hint)
        return None
    if isinstance(network_symbol, ModuleSymbol) and network_symbol.unbound:
        _report_unbound(checker, node, node.text, network_symbol)
        return BrokenSymbol()
    if isinstance(network_symbol, SequenceSymbol):
        hint = f"name one of its tasks or wires: `{node.text}.TASK`, `{node.text}.ACTUATOR`"
        checker.error("E106", node, f"`{node.text}` is a sequence, not a module, wire or actuator", hint)
        return BrokenSymbol()
    if network_symbol is None and not reject_private_name(checker, node, scope, path[0]):
        known_names = [*scope.visible_network_symbols, *scope.robot.network_symbols, *scope.aliases]
        checker.error(
            "E101",
            node,
            f"unknown module or wire `{node.text}`",
            checker.report.suggest(path[-1], known_names),
        )
    return network_symbol


def _report_unbound(checker: Checker, node: ast.Reference, name: str, module: ModuleSymbol) -> None:
    """Report a module that is used though it has inputs that are not bound."""
    inputs = ", ".join(f"{unbound} = ..." for unbound in module.unbound)
    plural = "inputs that are" if len(module.unbound) > 1 else "an input that is"
    message = f"module `{name}` has {plural} not bound: {quoted(module.unbound)}"
    if module.derivation is None or module.span is None:
        them = "them" if len(module.unbound) > 1 else "it"
        hint = f"derive a module that binds {them}, and use that: `module NAME = {name}({inputs})`"
        checker.error("E408", node, message, hint)
        return
    hint = f"bind {quoted(module.unbound)} there: `{module.derivation}{inputs})`"
    checker.error("E408", node, message, hint, Label(module.span, f"`{name}` is derived here"))


def actuator_named(checker: Checker, name: ast.NameNode) -> program_ir.Actuator | None:
    """Return the actuator of this name, or None after an error."""
    symbol = checker.scope.robot.network_symbols.get(name.text)
    if isinstance(symbol, ActuatorSymbol):
        return symbol.actuator
    if not isinstance(symbol, BrokenSymbol) and not checker.scope.may_be_lost(name.text):
        known_names = [
            n for n, s in checker.scope.robot.network_symbols.items() if isinstance(s, ActuatorSymbol)
        ]
        hint = checker.report.suggest(name.text, known_names) or (
            f"the robot has {', '.join(known_names)}" if known_names else None
        )
        checker.error("E402", name, f"unknown actuator `{name.text}`", hint)
    return None
