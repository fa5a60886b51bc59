"""Syntax tree to text. `parse(print(tree))` is the same tree, as a property test checks.

The layout is fixed: one declaration per paragraph, one clause per line, indented by two spaces. Comments are
not part of the tree and are lost.
"""

from __future__ import annotations

from collections.abc import Iterable

from colony.dsl import ast

_IF, _IMPLIES, _OR, _AND, _NOT, _COMPARISON, _SUM, _PRODUCT, _UNARY, _POSTFIX = range(10)
_LEVELS = {
    "implies": _IMPLIES,
    "or": _OR,
    "and": _AND,
    "+": _SUM,
    "-": _SUM,
    "*": _PRODUCT,
    "/": _PRODUCT,
}


def print_file(file: ast.File) -> str:
    """Return the text of a file."""
    head = [] if file.language is None else [f"language {file.language.version}\n"]
    return "\n".join([*head, *map(_declaration, file.declarations)])


def print_declarations(declarations: Iterable[ast.Declaration]) -> str:
    """Return the text of declarations."""
    return "\n".join(map(_declaration, declarations))


def print_expression(node: ast.Expression) -> str:
    """Return the text of an expression, with only the parentheses that it needs."""
    return _expression(node, _IF)


# --- expressions -----------------------------------------------------------------------------------


def _expression(node: ast.Expression, level: int) -> str:
    """Return the text, in parentheses if its context (`level`) binds tighter than the expression."""
    text, own = _text_and_level(node)
    return text if own >= level else f"({text})"


def _text_and_level(node: ast.Expression) -> tuple[str, int]:
    match node:
        case ast.NumberNode(digits=digits, unit=unit):
            return (f"{digits} {unit}" if unit else digits), _POSTFIX
        case ast.Boolean(value=value):
            return ("true" if value else "false"), _POSTFIX
        case ast.Reference():
            return node.text, _POSTFIX
        case ast.Prefix():
            return _prefix(node)
        case ast.Infix():
            return _infix(node)
        case ast.If(condition=condition, yes=yes, no=no):
            parts = [_expression(p, _IF) for p in (condition, yes, no)]
            return "if {} then {} else {}".format(*parts), _IF
        case ast.InRange() | ast.By() | ast.Is():
            return _relation(node), _COMPARISON
        case ast.IndexNode(array=array, index=index):
            return f"{_expression(array, _POSTFIX)}[{_expression(index, _IF)}]", _POSTFIX
        case ast.SliceOf(array=array, first=first, last=last):
            ends = f"{_expression(first, _SUM)}..{_expression(last, _SUM)}"
            return f"{_expression(array, _POSTFIX)}[{ends}]", _POSTFIX
        case ast.CallNode(function=function, arguments=arguments, named=named):
            parts = [*(_expression(a, _IF) for a in arguments), *map(_argument, named)]
            return f"{function.text}({', '.join(parts)})", _POSTFIX
        case ast.Comprehension() | ast.ElementsComprehension():
            return _comprehension(node), _POSTFIX


def _prefix(node: ast.Prefix) -> tuple[str, int]:
    if node.operator == "not":
        return f"not {_expression(node.operand, _NOT)}", _NOT
    return f"-{_expression(node.operand, _UNARY)}", _UNARY


def _relation(node: ast.InRange | ast.By | ast.Is) -> str:
    match node:
        case ast.InRange(operand=operand, low=low, high=high):
            return "{} in {} .. {}".format(*(_expression(p, _SUM) for p in (operand, low, high)))
        case ast.By(actuator=actuator, module=module):
            return f"{_expression(actuator, _SUM)} by {_expression(module, _SUM)}"
        case ast.Is(subject=subject, status=status):
            return f"{_expression(subject, _SUM)} is {status}"


def _infix(node: ast.Infix) -> tuple[str, int]:
    own = _LEVELS.get(node.operator, _COMPARISON)
    if own == _COMPARISON:
        left, right = _SUM, _SUM
    elif own == _IMPLIES:
        left, right = _OR, _IMPLIES
    else:
        left, right = own, own + 1
    return f"{_expression(node.left, left)} {node.operator} {_expression(node.right, right)}", own


def _comprehension(node: ast.Comprehension | ast.ElementsComprehension) -> str:
    condition = "" if node.condition is None else f" if {_expression(node.condition, _IF)}"
    names = node.variable.text
    if isinstance(node, ast.Comprehension):
        values = f"{_expression(node.low, _SUM)} .. {_expression(node.high, _SUM)}"
    else:
        names += "" if node.bearing is None else f", {node.bearing.text}"
        values = _expression(node.array, _IMPLIES)
    body = _expression(node.body, _IF)
    return f"{node.function.text}({body} for {names} in {values}{condition})"


# --- declarations ----------------------------------------------------------------------------------


def _block(head: str, lines: Iterable[str]) -> str:
    body = "".join(f"  {line}\n" for text in lines for line in text.splitlines())
    return f"{head} {{\n{body}}}\n"


def _arguments(arguments: tuple[ast.Argument, ...]) -> str:
    return ", ".join(map(_argument, arguments))


def _argument(node: ast.Argument) -> str:
    return f"{node.name.text} = {print_expression(node.value)}"


def _declaration(node: ast.Declaration) -> str:
    match node:
        case ast.RobotDecl():
            return _block(f"robot {node.name.text}", (_robot_item(i) for i in node.items))
        case ast.EnumDecl():
            return f"enum {node.name.text} {{ {_arguments(node.members)} }}\n"
        case ast.ImportDecl(path=path, alias=alias):
            return f'import "{path}"{f" as {alias.text}" if alias else ""}\n'
        case ast.RobotImportDecl() | ast.SensorDecl():
            return f"input {_sensor(node)}\n" if isinstance(node, ast.SensorDecl) else "import robot\n"
        case ast.ParamDecl() | ast.LetDecl() | ast.FunctionDecl() | ast.StateDecl() | ast.NextDecl():
            return _clause(node) + "\n"
        case ast.MachineDecl() | ast.SequenceDecl():
            return _machine(node)
        case ast.ModuleDecl():
            return _block(f"{_failsafe(node)}module {node.name.text}", _module(node))
        case ast.DerivedModuleDecl():
            head = f"{_failsafe(node)}module {node.name.text}"
            return f"{head} = {node.base.text}({_arguments(node.arguments)})\n"
        case ast.PythonModuleDecl():
            head = f'{_failsafe(node)}module {node.name.text} from python "{node.path}"'
            return _block(head, (_python_clause(c) for c in node.clauses))
        case ast.NetworkDecl():
            return _block("network", (f"{w.name.text} = {_wiring(w.wiring)}" for w in node.wires))
        case ast.LimitDecl():
            when = "" if node.condition is None else f" when {print_expression(node.condition)}"
            field = f"{node.actuator.text}.{node.field.text}"
            return f"limit {field} {node.relation} {print_expression(node.bound)}{when}\n"
        case ast.ContractDecl():
            in_time = " in time" if node.in_time else ""
            requirements = ", ".join(f'"{each}"' for each in node.requirements)
            head = f"{node.keyword} {node.name.text}{in_time}"
            head += f" requirement {requirements}" if requirements else ""
            return f"{head}: {print_expression(node.expression)}\n"
        case ast.TestDecl():
            return _block(f'test "{node.title}"', (_step(s) for s in node.steps))


def _robot_item(item: ast.RobotItem) -> str:
    match item:
        case ast.FrameDecl(period=period, jitter=jitter):
            around = "" if jitter is None else f" jitter {print_expression(jitter)}"
            return f"frame {print_expression(period)}{around}"
        case ast.SensorDecl():
            return f"sensor {_sensor(item)}"
        case ast.ActuatorDecl():
            return _actuator(item)


def _type(node: ast.TypeName) -> str:
    return ".".join(node.path)


def _range(node: ast.RangeNode | None) -> str:
    if node is None:
        return ""
    return f" range {_expression(node.low, _SUM)} .. {_expression(node.high, _SUM)}"


def _bearing(node: ast.BearingDecl | None) -> str:
    if node is None:
        return ""
    if node.angles is not None:
        return f" bearing [{', '.join(print_expression(angle) for angle in node.angles)}]"
    assert node.first is not None
    step = "" if node.step is None else f" step {_expression(node.step, _SUM)}"
    return f" bearing {_expression(node.first, _SUM)}{step}"


def _sensor(item: ast.SensorDecl) -> str:
    size = "" if item.size is None else f"[{print_expression(item.size)}]"
    default = "" if item.default is None else f" default {print_expression(item.default)}"
    within = "" if item.within is None else f" within {print_expression(item.within)}"
    type_ = f"{_type(item.type)}{_bearing(item.bearing)}{_range(item.range)}"
    head = f"{item.name.text}{size} : {type_}{default}"
    return f"{head} from {item.server.text}.{item.field.text}{within}"


def _field(item: ast.FieldDecl) -> str:
    default = "" if item.default is None else f" default {print_expression(item.default)}"
    return f"{item.name.text} : {_type(item.type)}{_range(item.range)}{default}"


def _actuator(item: ast.ActuatorDecl) -> str:
    fields = ", ".join(map(_field, item.fields))
    idle = item.idle.name.text
    if item.idle.arguments is not None:
        idle += f"({_arguments(item.idle.arguments)})"
    loss = f" on_loss {item.on_loss}" if item.on_loss else ""
    return (
        f"actuator {item.name.text} {{ {fields} }}\n"
        f"         to {item.server.text}.{item.command.text} idle {idle}{loss}"
    )


def _clause(node: ast.Clause) -> str:
    match node:
        case ast.InputDecl():
            return f"input {_parameter(node)}"
        case ast.FunctionDecl():
            parameters = ", ".join(map(_parameter, node.parameters))
            return f"let {node.name.text}({parameters}) = {print_expression(node.value)}"
        case ast.ParamDecl():
            param = f"param {node.name.text} = {print_expression(node.value)}"
            if node.interval is None:
                return param
            low, high = print_expression(node.interval.low), print_expression(node.interval.high)
            return f"tunable {param} in {low} .. {high}"
        case ast.LetDecl():
            return f"let {node.name.text} = {print_expression(node.value)}"
        case ast.StateDecl():
            type_ = "" if node.type is None else f" : {_type(node.type)}"
            return f"state {node.name.text}{type_} = {print_expression(node.initial)}"
        case ast.NextDecl():
            return f"next {node.name.text} = {print_expression(node.value)}"


def _parameter(node: ast.ParameterNode) -> str:
    size = "" if node.size is None else print_expression(node.size)
    shape = f"[{size}]" if node.is_array else ""
    initial = "" if node.initial is None else f" = {print_expression(node.initial)}"
    return f"{node.name.text}{shape} : {_type(node.type)}{initial}"


def _transition(node: ast.TransitionDecl) -> str:
    source = "any" if node.source is None else node.source.text
    return f"{_failsafe(node)}{source} -> {node.target.text} when {print_expression(node.condition)}"


def _machine(node: ast.MachineDecl | ast.SequenceDecl) -> str:
    if isinstance(node, ast.MachineDecl):
        lines = [f"start {node.initial.text}", *map(_transition, node.transitions)]
        return _block(f"machine {node.name.text}", lines)
    when = "" if node.when is None else f" when {print_expression(node.when)}"
    restart = " restart" if node.restarts else ""
    return _block(f"sequence {node.name.text}{when}{restart}", map(_task, node.tasks))


def _task(node: ast.TaskDecl) -> str:
    text = node.name.text
    if node.arguments or node.base.path != (text,):
        given = f"({_arguments(node.arguments)})" if node.arguments else ""
        text += f" = {node.base.text}{given}"
    text += f" until {print_expression(node.until)}"
    if node.within is None or node.otherwise is None:
        return text
    return f"{text} within {print_expression(node.within)} else {node.otherwise.text}"


def _failsafe(
    node: ast.ModuleDecl | ast.DerivedModuleDecl | ast.PythonModuleDecl | ast.TransitionDecl,
) -> str:
    return "failsafe " if node.failsafe else ""


def _module(node: ast.ModuleDecl) -> Iterable[str]:
    yield from (_clause(c) for c in node.clauses)
    yield f"when {print_expression(node.when)}"
    if node.do is not None:
        yield f"do {node.do.actuator.text}({_arguments(node.do.arguments)})"


def _python_clause(node: ast.PythonClause) -> str:
    match node:
        case ast.InputDecl() | ast.ParamDecl():
            return _clause(node)
        case ast.ReadsDecl(names=names):
            return "reads " + ", ".join(n.text for n in names)
        case ast.CommandsDecl(actuator=actuator):
            return f"commands {actuator.text}"
        case ast.RateDecl(period=period):
            return f"rate {print_expression(period)}"


def _wiring(node: ast.Wiring) -> str:
    """Return the text of a wiring. Only parentheses recurse, and the parser limits their nesting."""
    if isinstance(node, ast.Reference):
        return node.text
    parts = [_operand(node.operands[0])]
    for link, operand in zip(node.links, node.operands[1:], strict=True):
        window = "" if link.window is None else f"[{print_expression(link.window)}]"
        parts.append(f"{link.relation}{window} {_operand(operand)}")
    return " ".join(parts)


def _operand(node: ast.Wiring) -> str:
    return f"({_wiring(node)})" if isinstance(node, ast.ChainNode) else node.text


def _step(node: ast.StepDecl) -> str:
    if node.last is None or node.period is None:
        text = f"at {print_expression(node.first)}"
    else:
        times = [print_expression(t) for t in (node.first, node.last, node.period)]
        text = "from {} to {} every {}".format(*times)
    if node.given:
        text += " given " + ", ".join(_given(g) for g in node.given)
    if node.expect:
        text += " expect " + ", ".join(print_expression(e) for e in node.expect)
    return text


def _given(node: ast.GivenDecl) -> str:
    index = ""
    if node.index is not None and node.last is None:
        index = f"[{print_expression(node.index)}]"
    elif node.index is not None and node.last is not None:
        index = f"[{_expression(node.index, _SUM)} .. {_expression(node.last, _SUM)}]"
    match node.value:
        case ast.Missing():
            value = "missing"
        case ast.Elements(values=values):
            value = f"[{', '.join(print_expression(v) for v in values)}]"
        case _:
            value = print_expression(node.value)
    taken = "" if node.taken_ago is None else f" taken {print_expression(node.taken_ago)} ago"
    return f"{print_expression(node.sensor)}{index} = {value}{taken}"
