"""Parser callbacks: each rule of the grammar to its node of the syntax tree.

The parser calls them as it reduces, so no parse tree is ever built. They only build nodes: they check nothing
and raise nothing. Children include all tokens; an absent optional part is None.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import fields
from itertools import takewhile
from typing import Any, Literal, cast

from lark import Token

from colony.dsl import ast

Children = Sequence[Any]


def _start(children: Children) -> int:
    first = next(child for child in children if child is not None)
    return cast("int", first.start_pos if isinstance(first, Token) else first.start)


def _end(children: Children) -> int:
    for child in reversed(children):
        if child is not None:
            return cast("int", child.end_pos if isinstance(child, Token) else child.end)
    return 0


def _extent(children: Children) -> dict[str, int]:
    return {"start": _start(children), "end": _end(children)}


def _name(token: Token) -> ast.NameNode:
    return ast.NameNode(text=token.value, **_extent((token,)))


def _of(kind: type | tuple[type, ...], children: Iterable[Any]) -> tuple[Any, ...]:
    return tuple(c for c in children if isinstance(c, kind))


def _unquoted(token: Token) -> str:
    return cast("str", token.value[1:-1])


EXPRESSIONS: tuple[type, ...] = ast.Expression.__args__


class TreeBuilder:
    """A method for each rule of the grammar, named after it."""

    def file(self, c: Children) -> ast.File:
        """Build a file from its declarations."""
        return ast.File(language=c[0], declarations=tuple(c[1:]), start=0, end=_end(c))

    def language(self, c: Children) -> ast.LanguageDecl:
        """Build the line that says which version of the language the file has."""
        return ast.LanguageDecl(version=c[1].value, **_extent(c))

    # --- robot

    def robot(self, c: Children) -> ast.RobotDecl:
        """Build a robot from its frame, sensors and actuators."""
        items = _of((ast.FrameDecl, ast.SensorDecl, ast.ActuatorDecl), c)
        return ast.RobotDecl(name=_name(c[1]), items=items, **_extent(c))

    def frame(self, c: Children) -> ast.FrameDecl:
        """Build the declaration of the frame period."""
        _, period, _, jitter = c
        return ast.FrameDecl(period=period, jitter=jitter, **_extent(c))

    def sensor(self, c: Children) -> ast.SensorDecl:
        """Build a sensor declaration."""
        _, name, size, _, type_, bearing, range_, default, _, server, _, field, within = c
        return ast.SensorDecl(
            name=_name(name),
            size=size,
            type=type_,
            bearing=bearing,
            range=range_,
            default=default,
            server=_name(server),
            field=_name(field),
            within=within,
            **_extent(c),
        )

    program_input = sensor

    def second(self, c: Children) -> Any:
        """Return the part that follows the word or bracket."""
        return c[1]

    def bearing(self, c: Children) -> ast.BearingDecl:
        """Build the bearings of a sensor."""
        if isinstance(c[1], ast.Elements):
            return ast.BearingDecl(angles=c[1].values, first=None, step=None, **_extent(c))
        return ast.BearingDecl(angles=None, first=c[1], step=c[2], **_extent(c))

    size = default = within = bearing_step = window = limit_when = condition = state_type = initial = (
        sequence_when
    ) = parenthesized = second

    def alias(self, c: Children) -> ast.NameNode:
        """Return the name behind `as`."""
        return _name(c[1])

    def on_loss(self, c: Children) -> str:
        """Return the reaction to a lost client, as written."""
        return cast("str", c[1].value)

    def actuator(self, c: Children) -> ast.ActuatorDecl:
        """Build an actuator declaration."""
        server, _, command, _, idle, on_loss = c[-6:]
        return ast.ActuatorDecl(
            name=_name(c[1]),
            fields=_of(ast.FieldDecl, c),
            server=_name(server),
            command=_name(command),
            idle=idle,
            on_loss=on_loss,
            start=_start(c),
            end=idle.end,
        )

    def field(self, c: Children) -> ast.FieldDecl:
        """Build a field of an actuator."""
        return ast.FieldDecl(name=_name(c[0]), type=c[2], range=c[3], default=c[4], **_extent(c))

    def idle(self, c: Children) -> ast.IdleDecl:
        """Build the idle command of an actuator."""
        return ast.IdleDecl(name=_name(c[0]), arguments=None if c[1] is None else c[1][0], **_extent(c[:1]))

    def range(self, c: Children) -> ast.RangeNode:
        """Build a range."""
        return ast.RangeNode(low=c[1], high=c[3], **_extent(c))

    def type(self, c: Children) -> ast.TypeName:
        """Build the name of a type."""
        return ast.TypeName(path=tuple(t.value for t in c[::2]), **_extent(c))

    def arguments(self, c: Children) -> tuple[tuple[ast.Argument, ...], int]:
        """Return the arguments and the offset at which they end."""
        return _of(ast.Argument, c), _end(c)

    def argument(self, c: Children) -> ast.Argument:
        """Build a named argument."""
        return ast.Argument(name=_name(c[0]), value=c[2], **_extent(c))

    def enum(self, c: Children) -> ast.EnumDecl:
        """Build an enum declaration."""
        return ast.EnumDecl(name=_name(c[1]), members=_of(ast.Argument, c), **_extent(c))

    def importing(self, c: Children) -> ast.ImportDecl:
        """Build an import."""
        return ast.ImportDecl(path=_unquoted(c[1]), alias=c[2], **_extent(c))

    def robot_import(self, c: Children) -> ast.RobotImportDecl:
        """Build the import of the program's robot."""
        return ast.RobotImportDecl(**_extent(c))

    # --- derived values

    def param(self, c: Children) -> ast.ParamDecl:
        """Build a param declaration."""
        return ast.ParamDecl(name=_name(c[1]), value=c[3], start=_start(c), end=_end(c))

    def tunable_param(self, c: Children) -> ast.ParamDecl:
        """Build the declaration of a tunable param."""
        interval = ast.RangeNode(low=c[6], high=c[8], start=c[6].start, end=c[8].end)
        return ast.ParamDecl(name=_name(c[2]), value=c[4], interval=interval, start=_start(c), end=_end(c))

    def let(self, c: Children) -> ast.LetDecl:
        """Build a let declaration."""
        return ast.LetDecl(name=_name(c[1]), value=c[3], **_extent(c))

    def function(self, c: Children) -> ast.FunctionDecl:
        """Build the declaration of a function."""
        parameters = _of(ast.ParameterNode, c)
        return ast.FunctionDecl(name=_name(c[1]), parameters=parameters, value=c[-1], **_extent(c))

    def parameter(self, c: Children) -> ast.ParameterNode:
        """Build a parameter of a function."""
        return ast.ParameterNode(**_parameter(c))

    def shape(self, c: Children) -> tuple[ast.Expression | None]:
        """Return the length of an array, None for any length, in a tuple."""
        return (c[1],)

    def input(self, c: Children) -> ast.InputDecl:
        """Build an input of a module."""
        values = {f.name: getattr(c[1], f.name) for f in fields(ast.ParameterNode)}
        return ast.InputDecl(**{**values, **_extent(c)})

    def state(self, c: Children) -> ast.StateDecl:
        """Build a state declaration."""
        return ast.StateDecl(name=_name(c[1]), type=c[2], initial=c[4], **_extent(c))

    def next(self, c: Children) -> ast.NextDecl:
        """Build the declaration of a state's next value."""
        return ast.NextDecl(name=_name(c[1]), value=c[3], **_extent(c))

    def machine(self, c: Children) -> ast.MachineDecl:
        """Build a state machine."""
        transitions = _of(ast.TransitionDecl, c)
        initial, start, end = _name(c[4]), _start(c), _end(c)
        return ast.MachineDecl(
            name=_name(c[1]), initial=initial, transitions=transitions, start=start, end=end
        )

    def transition(self, c: Children) -> ast.TransitionDecl:
        """Build a transition of a state machine; its source is None for `any`."""
        failsafe, source, _, target, _, condition = c
        return ast.TransitionDecl(
            failsafe=failsafe is not None,
            source=None if source.type == "ANY" else _name(source),
            target=_name(target),
            condition=condition,
            through=None,
            **_extent(c),
        )

    # --- sequences

    def sequence(self, c: Children) -> ast.SequenceDecl:
        """Build a sequence from its tasks."""
        restarts = c[3] is not None and c[3].type == "RESTART"
        tasks = _of(ast.TaskDecl, c)
        return ast.SequenceDecl(name=_name(c[1]), when=c[2], restarts=restarts, tasks=tasks, **_extent(c))

    def task(self, c: Children) -> ast.TaskDecl:
        """Build a task; without a base its name is that of the module, too."""
        name, given, _, until, limit = c
        named = ast.Reference(path=(name.value,), **_extent(c[:1]))
        base, arguments = given or (named, ())
        within, otherwise = limit or (None, None)
        end = until.end if otherwise is None else otherwise.end
        return ast.TaskDecl(
            name=_name(name),
            base=base,
            arguments=arguments,
            until=until,
            within=within,
            otherwise=otherwise,
            start=_start(c),
            end=end,
        )

    def task_base(self, c: Children) -> tuple[ast.Reference, tuple[ast.Argument, ...]]:
        """Return the module that a task is derived from, with its arguments."""
        return c[1], () if c[2] is None else c[2][0]

    def time_limit(self, c: Children) -> tuple[ast.Expression, ast.NameNode]:
        """Return the time limit of a task, and the phase that follows it."""
        return c[1], _name(c[3])

    # --- modules

    def module(self, c: Children) -> ast.ModuleDecl:
        """Build a module."""
        (failsafe, _, name), clauses, (when, do) = c[:3], tuple(c[4:-4]), c[-3:-1]
        return ast.ModuleDecl(
            failsafe=failsafe is not None, name=_name(name), clauses=clauses, when=when, do=do, **_extent(c)
        )

    def do(self, c: Children) -> ast.DoDecl:
        """Build the command of a module."""
        arguments, end = c[2]
        return ast.DoDecl(actuator=_name(c[1]), arguments=arguments, start=_start(c), end=end)

    def derived_module(self, c: Children) -> ast.DerivedModuleDecl:
        """Build a module derived from another one."""
        failsafe, _, name, _, base, given = c
        arguments, end = ((), base.end) if given is None else given
        return ast.DerivedModuleDecl(
            failsafe=failsafe is not None,
            name=_name(name),
            base=base,
            arguments=arguments,
            start=_start(c),
            end=end,
        )

    def python_module(self, c: Children) -> ast.PythonModuleDecl:
        """Build the declaration of a module in Python."""
        clauses, path = tuple(c[7:-1]), _unquoted(c[5])
        return ast.PythonModuleDecl(
            failsafe=c[0] is not None, name=_name(c[2]), path=path, clauses=clauses, **_extent(c)
        )

    def reads(self, c: Children) -> ast.ReadsDecl:
        """Build the names that a module in Python reads."""
        return ast.ReadsDecl(names=_of(ast.Reference, c), **_extent(c))

    def commands(self, c: Children) -> ast.CommandsDecl:
        """Build the declaration of the actuator that a module in Python commands."""
        return ast.CommandsDecl(actuator=_name(c[1]), **_extent(c))

    def rate(self, c: Children) -> ast.RateDecl:
        """Build the rate of a module in Python."""
        return ast.RateDecl(period=c[1], **_extent(c))

    # --- network

    def network(self, c: Children) -> ast.NetworkDecl:
        """Build a network from its wires."""
        return ast.NetworkDecl(wires=tuple(c[2:-1]), **_extent(c))

    def wire(self, c: Children) -> ast.WireDecl:
        """Build a wire."""
        return ast.WireDecl(name=_name(c[0]), wiring=c[2], **_extent(c))

    def chain(self, c: Children) -> ast.ChainNode:
        """Build a chain from its operands and the links between them."""
        return ast.ChainNode(operands=tuple(c[::2]), links=tuple(c[1::2]), **_extent(c))

    def link(self, c: Children) -> ast.LinkNode:
        """Build a link of a chain: `suppresses` or `inhibits`, with its time constant."""
        relation: Literal["suppresses", "inhibits"] = (
            "suppresses" if c[0].type == "SUPPRESSES" else "inhibits"
        )
        return ast.LinkNode(relation=relation, window=c[1], **_extent(c[:1]))

    # --- limits, contracts, tests

    def limit(self, c: Children) -> ast.LimitDecl:
        """Build a limit."""
        _, actuator, _, field, relation, bound, condition = c
        return ast.LimitDecl(
            actuator=_name(actuator),
            field=_name(field),
            relation="<=" if relation.type == "AT_MOST" else ">=",
            bound=bound,
            condition=condition,
            **_extent(c),
        )

    def contract(self, c: Children) -> ast.ContractDecl:
        """Build a contract."""
        _, name, in_time, requirements, _, expression = c
        return ast.ContractDecl(
            name=_name(name),
            expression=expression,
            in_time=in_time is not None,
            reach=False,
            requirements=requirements or (),
            **_extent(c),
        )

    def reach(self, c: Children) -> ast.ContractDecl:
        """Build a `reach`."""
        _, name, requirements, _, expression = c
        return ast.ContractDecl(
            name=_name(name),
            expression=expression,
            in_time=False,
            reach=True,
            requirements=requirements or (),
            **_extent(c),
        )

    def assume(self, c: Children) -> ast.AssumeDecl:
        """Build an assumption."""
        _, name, _, expression = c
        return ast.AssumeDecl(
            name=_name(name), expression=expression, in_time=False, reach=False, requirements=(), **_extent(c)
        )

    def requirements(self, c: Children) -> tuple[str, ...]:
        """Return the requirements that a contract belongs to."""
        return tuple(_unquoted(text) for text in c[1::2])

    def in_time(self, c: Children) -> bool:
        """Return that a contract holds in time."""
        return True

    def test(self, c: Children) -> ast.TestDecl:
        """Build a test from its steps."""
        return ast.TestDecl(title=_unquoted(c[1]), steps=_of(ast.StepDecl, c), **_extent(c))

    def at(self, c: Children) -> tuple[int, int, tuple[Any, Any, Any]]:
        """Return the start, end and (first, None, None) of a step at a single time."""
        return _start(c), _end(c), (c[1], None, None)

    def span(self, c: Children) -> tuple[int, int, tuple[Any, Any, Any]]:
        """Return the start, end and (first, last, period) of a step that is repeated."""
        return _start(c), _end(c), (c[1], c[3], c[5])

    def step(self, c: Children) -> ast.StepDecl:
        """Build a step of a test."""
        start, end, (first, last, period) = c[0]
        given, expect = c[1] or (), c[2] or ()
        end = expect[-1].end if expect else given[-1].end if given else end
        return ast.StepDecl(
            first=first, last=last, period=period, given=given, expect=expect, start=start, end=end
        )

    def given(self, c: Children) -> tuple[ast.GivenDecl, ...]:
        """Return the values that a step gives to sensors."""
        return _of(ast.GivenDecl, c)

    def assignment(self, c: Children) -> ast.GivenDecl:
        """Build the value that a step gives to a sensor or to an element of it."""
        sensor, place, _, value, taken_ago = c
        index, last = place or (None, None)
        return ast.GivenDecl(
            sensor=sensor, index=index, last=last, value=value, taken_ago=taken_ago, **_extent(c)
        )

    def place(self, c: Children) -> tuple[ast.Expression, ast.Expression | None]:
        """Return the index of the element that a step gives, or the first and last of several."""
        return c[1], c[3] if len(c) > 3 else None

    def taken(self, c: Children) -> ast.Expression:
        """Return the age of a value that a step gives."""
        return cast("ast.Expression", c[1])

    def missing(self, c: Children) -> ast.Missing:
        """Build the value `missing`."""
        return ast.Missing(**_extent(c))

    def elements(self, c: Children) -> ast.Elements:
        """Build a list of elements."""
        return ast.Elements(values=_of(EXPRESSIONS, c), **_extent(c))

    def expect(self, c: Children) -> tuple[ast.Expression, ...]:
        """Return the expectations of a step."""
        return _of(EXPRESSIONS, c)

    # --- expressions

    def conditional(self, c: Children) -> ast.If:
        """Build a conditional expression."""
        _, condition, _, yes, _, no = c
        depth = 1 + max(condition.depth, yes.depth, no.depth)
        return ast.If(condition=condition, yes=yes, no=no, depth=depth, start=_start(c), end=no.end)

    def infix(self, c: Children) -> ast.Infix:
        """Build an infix expression."""
        left, operator, right = c
        return ast.Infix(
            operator=operator.value,
            left=left,
            right=right,
            depth=1 + max(left.depth, right.depth),
            start=left.start,
            end=right.end,
        )

    def prefix(self, c: Children) -> ast.Prefix:
        """Build a negation."""
        operator: Literal["-", "not"] = "-" if c[0].type == "MINUS" else "not"
        return ast.Prefix(operator=operator, operand=c[1], depth=1 + c[1].depth, **_extent(c))

    def in_range(self, c: Children) -> ast.InRange:
        """Build a range test."""
        operand, _, low, _, high = c
        depth = 1 + max(operand.depth, low.depth, high.depth)
        return ast.InRange(operand=operand, low=low, high=high, depth=depth, **_extent(c))

    def by(self, c: Children) -> ast.By:
        """Build a test for the winner of an actuator."""
        return ast.By(actuator=c[0], module=c[2], depth=2, **_extent(c))

    def is_status(self, c: Children) -> ast.Is:
        """Build a test of a status."""
        status = cast("ast.Status", c[2].value)
        return ast.Is(subject=c[0], status=status, depth=2, **_extent(c))

    def index(self, c: Children) -> ast.IndexNode:
        """Build an element access."""
        return ast.IndexNode(array=c[0], index=c[2], depth=1 + max(c[0].depth, c[2].depth), **_extent(c))

    def slice(self, c: Children) -> ast.SliceOf:
        """Build a slice."""
        array, _, first, _, last, _ = c
        depth = 1 + max(array.depth, first.depth, last.depth)
        return ast.SliceOf(array=array, first=first, last=last, depth=depth, **_extent(c))

    def number(self, c: Children) -> ast.NumberNode:
        """Build a number from its digits and unit."""
        digits, unit = split_number(c[0].value)
        return ast.NumberNode(digits=digits, unit=unit, start=_start(c), end=_end(c))

    def boolean(self, c: Children) -> ast.Boolean:
        """Build a boolean constant."""
        return ast.Boolean(value=c[0].type == "TRUE", **_extent(c))

    def call(self, c: Children) -> ast.CallNode:
        """Build a function call."""
        arguments, named = _of(EXPRESSIONS, c), _of(ast.Argument, c)
        depth = 1 + max((a.depth for a in (*arguments, *(n.value for n in named))), default=0)
        return ast.CallNode(function=_called(c), arguments=arguments, named=named, depth=depth, **_extent(c))

    def comprehension(self, c: Children) -> ast.Comprehension:
        """Build a comprehension."""
        function, _, body, _, variable, _, low, _, high, condition, _ = c
        parts = [body, low, high] + ([] if condition is None else [condition])
        return ast.Comprehension(
            function=_name(function),
            body=body,
            variable=_name(variable),
            low=low,
            high=high,
            condition=condition,
            depth=1 + max(p.depth for p in parts),
            **_extent(c),
        )

    def elements_comprehension(self, c: Children) -> ast.ElementsComprehension:
        """Build a comprehension over the elements of an array."""
        function, _, body, _, variable, *pair, _, array, condition, _ = c
        bearing = next((token for token in pair if token is not None and token.type == "NAME"), None)
        parts = [body, array] + ([] if condition is None else [condition])
        return ast.ElementsComprehension(
            function=_name(function),
            body=body,
            variable=_name(variable),
            bearing=None if bearing is None else _name(bearing),
            array=array,
            condition=condition,
            depth=1 + max(p.depth for p in parts),
            **_extent(c),
        )

    def reference(self, c: Children) -> ast.Reference:
        """Build a reference from its dotted path."""
        return ast.Reference(path=tuple([t.value for t in c[::2]]), **_extent(c))


def _parameter(c: Children) -> dict[str, Any]:
    name, shape, _, type_, initial = c
    is_array, size = shape is not None, None if shape is None else shape[0]
    parts = {"name": _name(name), "is_array": is_array, "size": size, "type": type_, "initial": initial}
    return {**parts, "start": _start(c), "end": _end([type_, initial])}


def _called(c: Children) -> ast.NameNode:
    """Return the name, perhaps dotted, of the function that is called."""
    if c[1].type == "LPAR":
        return _name(c[0])
    parts = list(takewhile(lambda token: token.type != "LPAR", c))
    return ast.NameNode(text="".join([t.value for t in parts]), **_extent(parts))


def split_number(text: str) -> tuple[str, str | None]:
    """Split `600 mm` into `600` and `mm`: the digits, with any exponent, end where the unit begins."""
    for i, character in enumerate(text):
        if character.isspace() or (character.isalpha() and not _is_exponent(text, i)):
            return text[:i], text[i:].strip() or None
    return text, None


def _is_exponent(text: str, i: int) -> bool:
    return text[i] in "eE" and i + 1 < len(text) and (text[i + 1].isdigit() or text[i + 1] in "+-")
