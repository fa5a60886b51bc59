"""The statements in C that decide what is sent to an actuator once its winner is known.

They compute what `colony.execute.settle` computes: limits, range, or the idle command.
"""

from __future__ import annotations

from math import inf

from colony.compile.backends.c.expressions import CTexts, identifier, literal
from colony.compile.backends.python.plan import ActuatorPlan
from colony.compile.backends.python.text import Precedence, UniqueNames
from colony.execute.code import LimitCode
from colony.ir.program import Actuator
from colony.ir.types import Bool


def decision_lines(
    plan: ActuatorPlan, out: str, names: UniqueNames, texts: CTexts, before: list[str], nobody: str
) -> list[str]:
    """Return the statements for one actuator; `out` is its outcome, `before` what its limits need."""
    actuator = plan.actuator.actuator
    name, by = actuator.name, names.by[actuator.name]
    fields = [names.field[name, i] for i in range(len(actuator.fields))]
    lines = [f"{out}.by = {by};", f"{out}.reason = COLONY_OK;", f"{out}.reason_field = 0;"]
    lines += [f"{out}.changed[{i}] = COLONY_UNCHANGED;" for i in range(len(fields))]
    if plan.groups:
        tests = []
        if plan.may_be_blind:
            tests.append((names.blind[name], "COLONY_BLIND"))
        numbers = [f for f, of in zip(fields, actuator.fields, strict=True) if not isinstance(of.type, Bool)]
        if numbers:
            finite = " && ".join(f"colony_finite({f})" for f in numbers)
            tests.append((f"!({finite})" if len(numbers) > 1 else f"!{finite}", "COLONY_NOT_FINITE"))
        chain = "".join(
            f"{'} else ' if i else ''}if ({by} != {nobody} && {test}) {{\n    {out}.reason = {reason};\n"
            for i, (test, reason) in enumerate(tests)
        ).splitlines()
        settled = [*before, *_settled(plan, names, texts, out)]
        if settled:
            head = f"if ({by} != {nobody}) {{"
            lines += [*chain, f"}} else {head}" if chain else head, *(f"    {line}" for line in settled), "}"]
        else:
            lines += [*chain, *(["}"] if chain else [])]
    return [*lines, *_sent(actuator, names, out, nobody, fields)]


def _settled(plan: ActuatorPlan, names: UniqueNames, texts: CTexts, out: str) -> list[str]:
    """Return the statements that bound a finite command."""
    actuator = plan.actuator.actuator
    limits = {
        limit.field_index: [x for x in plan.actuator.limits if x.field_index == limit.field_index]
        for limit in plan.actuator.limits
    }
    lines, branches = list[str](), list[tuple[str, list[str]]]()
    if actuator.idle is None:
        for i in sorted(limits):
            for limit in limits[i]:
                if texts.text(limit.known).text != "true":
                    test = _both(
                        _applies(limit, texts), f"!{texts.text(limit.known).inside(Precedence.SIGN)}"
                    )
                    branches.append((test, _fault(out, "COLONY_BOUND_MISSING", i)))
    clamps = list[str]()
    for i, field in enumerate(actuator.fields):
        if isinstance(field.type, Bool):
            continue
        low = literal(-inf if field.low is None else field.low).text
        high = literal(inf if field.high is None else field.high).text
        least, most, value = low, high, names.field[actuator.name, i]
        if i in limits:
            least, most = names.new(f"{value}_low"), names.new(f"{value}_high")
            lines += [f"double {least} = {low};", f"double {most} = {high};"]
            for limit in limits[i]:
                lines += _limit(limit, actuator, texts, least, most, names)
            branches.append((f"{least} > {most}", _fault(out, "COLONY_CONTRADICTION", i)))
        elif field.low is None and field.high is None:
            continue
        clamps.append(f"{out}.changed[{i}] = colony_bounded(&{value}, {least}, {most}, {low}, {high});")
    too_large = [
        f"!colony_finite({names.field[actuator.name, i]} / {literal(f.factor).text})"
        for i, f in enumerate(actuator.fields)
        if not isinstance(f.type, Bool) and f.factor < 1.0
    ]
    if too_large:
        unchanged = [f"    {out}.changed[{i}] = COLONY_UNCHANGED;" for i in range(len(actuator.fields))]
        clamps += [
            f"if ({' || '.join(too_large)}) {{",
            f"    {out}.reason = COLONY_NOT_FINITE;",
            *unchanged,
            "}",
        ]
    if not branches:
        return [*lines, *clamps]
    for i, (test, body) in enumerate(branches):
        lines += [f"{'} else ' if i else ''}if ({test}) {{", *(f"    {line}" for line in body)]
    return [*lines, "} else {", *(f"    {line}" for line in clamps), "}"]


def _limit(
    limit: LimitCode, actuator: Actuator, texts: CTexts, least: str, most: str, names: UniqueNames
) -> list[str]:
    """Return the statements that apply a limit to the bounds of a field."""
    bound, known = texts.text(limit.bound), texts.text(limit.known)
    text = bound.text
    if actuator.idle is not None and known.text != "true":
        otherwise = literal(actuator.idle[limit.field_index]).text
        text = f"{known.inside(Precedence.OR)} ? {bound.inside(Precedence.OR)} : {otherwise}"
    name, target, sign = names.new("bound"), *((most, "<") if limit.relation == "<=" else (least, ">"))
    lines = [f"const double {name} = {text};"]
    test = _both(_applies(limit, texts), f"{name} {sign} {target}")
    return [*lines, f"if ({test}) {{", f"    {target} = {name};", "}"]


def _applies(limit: LimitCode, texts: CTexts) -> str:
    text = texts.text(limit.applies)
    return "" if text.text == "true" else text.inside(Precedence.AND)


def _both(first: str, second: str) -> str:
    return f"{first} && {second}" if first else second


def _fault(out: str, reason: str, field: int) -> list[str]:
    return [f"{out}.reason = {reason};", f"{out}.reason_field = {field};"]


def _sent(actuator: Actuator, names: UniqueNames, out: str, nobody: str, fields: list[str]) -> list[str]:
    """Return the statements that send the command, or the idle command."""
    commanded = names.commanded[actuator.name]
    lines = [f"const bool {commanded} = {names.by[actuator.name]} != {nobody} && {out}.reason == COLONY_OK;"]
    idle = actuator.idle
    if fields:
        lines.append(f"if (!{commanded}) {{")
        for i, (field, of) in enumerate(zip(fields, actuator.fields, strict=True)):
            zero: float | bool = False if isinstance(of.type, Bool) else 0.0
            lines.append(f"    {field} = {literal(zero if idle is None else idle[i]).text};")
        lines.append("}")
    lines.append(f"{out}.sent = {commanded if idle is None else 'true'};")
    for field, of in zip(fields, actuator.fields, strict=True):
        plain = isinstance(of.type, Bool) or of.factor == 1.0
        value = field if plain else f"{field} / {literal(of.factor).text}"
        lines.append(f"{out}.command.{identifier(of.name)} = {value};")
    return lines
