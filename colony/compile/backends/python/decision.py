"""Statements that decide what is sent to an actuator once its winner is known.

A command that is finite and within limits and range, provably or by a check, is sent unchanged; any other is
passed to `settle`.
"""

from __future__ import annotations

from math import isfinite

from colony.compile.backends.python.expressions import Expressions
from colony.compile.backends.python.names import Names
from colony.compile.backends.python.plan import ActuatorPlan
from colony.compile.backends.python.ranges import Range
from colony.compile.backends.python.sensor_validation import values
from colony.compile.backends.python.text import Binding, literal
from colony.execute.code import LimitCode
from colony.ir.program import ActuatorField, in_declared_units
from colony.ir.types import Bool


class DecisionText:
    """The statements for one actuator. With `observed`, they keep what is sent for contracts to read."""

    def __init__(
        self,
        plan: ActuatorPlan,
        names: Names,
        expressions: Expressions,
        ranges: list[Range],
        observed: bool,
    ) -> None:
        self.plan = plan
        self.actuator = plan.actuator.actuator
        self.names = names
        self.expressions = expressions
        self.ranges = ranges
        self.observed = observed
        self.name = self.actuator.name
        self.by = names.by[self.name]
        self.fields = [names.field[self.name, i] for i in range(len(self.actuator.fields))]
        self.target = names.decision[self.name]

    def lines(self) -> list[str]:
        """Return the statements that decide what is sent to the actuator."""
        if not self.plan.groups:
            return self.idle(by=self.observed)
        lines = [f"if {self.by} is None:", *_indented(self.idle(by=False))]
        if self.plan.may_be_blind:
            lines += [f"elif {self.names.blind[self.name]}:", *_indented(self.blind())]
        checks = self.checks()
        before = self.expressions.statements.get(self.plan.limits)
        if before:
            return [*lines, "else:", *_indented([*before, *self.command(checks)])]
        first, *rest = self.command(checks)
        if not checks:
            return [*lines, "else:", *_indented([first, *rest])]
        return [*lines, f"el{first}", *rest]

    def blind(self) -> list[str]:
        """Return the idle command, for a winner that is failsafe and blind."""
        record = f"records = (*records, ('missing', {self.by}))"
        return [record, *self.idle_command(self.by, "'missing'")]

    def idle(self, by: bool) -> list[str]:
        """Return the idle command, or nothing for `idle hold`."""
        lines = self.idle_command("None", "None")
        return [lines[0], f"{self.by} = None", *lines[1:]] if by else lines

    def idle_command(self, by: str, fault: str) -> list[str]:
        """Return the statements for the idle command."""
        idle = self.actuator.idle
        declared_values = in_declared_units(idle, self.actuator.fields)
        shown = "None" if declared_values is None else values(declared_values)
        lines = [f"{self.target} = ({self.name!r}, {by}, {shown}, {fault})"]
        if self.observed:
            lines.append(f"{self.names.commanded[self.name]} = False")
            sent = idle or tuple(False if isinstance(f.type, Bool) else 0.0 for f in self.actuator.fields)
            lines += [f"{field} = {literal(x).text}" for field, x in zip(self.fields, sent, strict=True)]
        return lines

    def command(self, checks: list[str]) -> list[str]:
        """Return the statements for the winner's command: as is if the checks hold, else through `settle`."""
        declared_values = self.declared_values(self.fields)
        direct = [f"{self.target} = ({self.name!r}, {self.by}, {declared_values}, None)"]
        if self.observed:
            direct.append(f"{self.names.commanded[self.name]} = True")
        if not checks:
            return direct
        single = checks[0][1:-1] if checks[0].startswith("(") else checks[0]
        condition = " and ".join(checks) if len(checks) > 1 else single
        return [f"if {condition}:", *_indented(direct), "else:", *_indented(self.settled())]

    def declared_values(self, fields: list[str]) -> str:
        """Return a command in declared units."""
        return _tuple(
            [
                field if spec.factor == 1.0 else f"{field} / {literal(spec.factor).text}"
                for field, spec in zip(fields, self.actuator.fields, strict=True)
            ]
        )

    def constants(self) -> list[str]:
        """Return the bounds passed to `settle`, as a module-level statement."""
        bounds = _tuple([_field(f) for f in self.actuator.fields])
        return [f"{self.names.bounds[self.name]} = {bounds}"]

    def settled(self) -> list[str]:
        """Return the statements that call `settle`."""
        limits = " + ".join(self.limit(limit) for limit in self.plan.actuator.limits) or "()"
        idle = "None" if self.actuator.idle is None else values(self.actuator.idle)
        bounds = self.names.bounds[self.name]
        arguments = f"{self.name!r}, {self.by}, {_tuple(self.fields)}, {bounds}, {limits}, {idle}, records"
        declared_values = "settled"
        if any(spec.factor != 1.0 for spec in self.actuator.fields):
            declared_values = self.declared_values([f"settled[{i}]" for i in range(len(self.fields))])
            if self.actuator.idle is None:
                declared_values = f"None if settled is None else {declared_values}"
        lines = [
            f"fault, settled, records = settle({arguments})",
            f"{self.target} = ({self.name!r}, {self.by}, {declared_values}, fault)",
        ]
        if self.observed:
            lines.append(f"{self.names.commanded[self.name]} = fault is None")
        if self.observed and self.fields:
            unpacked = f"{', '.join(self.fields)}{',' if len(self.fields) == 1 else ''} = settled"
            if self.actuator.idle is None:
                lines += ["if settled is not None:", f"    {unpacked}"]
            else:
                lines.append(unpacked)
        return lines

    def limit(self, limit: LimitCode) -> str:
        """Return a limit as `settle` takes it, if it applies."""
        bound, known = self.expressions.text(limit.bound), self.expressions.text(limit.known)
        text = (
            bound.text
            if known.text == "True"
            else f"{bound.inside(Binding.OR)} if {known.inside(Binding.OR)} else None"
        )
        limit_tuple = f"(({limit.field_index}, {limit.relation == '<='}, {text}),)"
        applies = self.expressions.text(limit.applies)
        return (
            limit_tuple
            if applies.text == "True"
            else f"({limit_tuple} if {applies.inside(Binding.OR)} else ())"
        )

    def checks(self) -> list[str]:
        """Return the checks under which a command needs no `settle`, without those that always hold."""
        checks = []
        for limit in self.plan.actuator.limits:
            field = self.fields[limit.field_index]
            check = f"{field} {limit.relation} {self.expressions.text(limit.bound).inside(Binding.SUM)}"
            known = self.expressions.text(limit.known)
            if known.text != "True":
                check = f"({known.inside(Binding.AND)} and {check})"
            applies = self.expressions.text(limit.applies)
            exempt = f"not {applies.inside(Binding.NOT)} or "
            checks.append(check if applies.text == "True" else f"({exempt}{check})")
        for i, spec in enumerate(self.actuator.fields):
            checks += self.field_checks(i, spec)
        return checks

    def field_checks(self, i: int, field: ActuatorField) -> list[str]:
        """Return the checks of a field's value that its known ranges do not make superfluous."""
        if isinstance(field.type, Bool):
            return []
        clients = [c.client for g in self.plan.groups for c in g.clients]
        ranges = [self.ranges[c.fields[i]] for c in clients]
        name, low, high = self.fields[i], field.low, field.high
        bounded = all(r.within(low, high) for r in ranges)
        finite = all(
            r.finite and isfinite(r.low / field.factor) and isfinite(r.high / field.factor) for r in ranges
        )
        checks = []
        if low is not None and high is not None:
            finite = finite or (isfinite(low / field.factor) and isfinite(high / field.factor))
            if not bounded:
                checks.append(f"{literal(low).text} <= {name} <= {literal(high).text}")
        elif not bounded:
            checks.append(f"{literal(low).text} <= {name}" if low is not None else f"{name} <= {_high(high)}")
        if not finite:
            declared_values = name if field.factor == 1.0 else f"{name} / {literal(field.factor).text}"
            checks.append(f"isfinite({declared_values})")
        return checks


def _high(high: float | None) -> str:
    return "inf" if high is None else literal(high).text


def _field(field: ActuatorField) -> str:
    low, high = ("None" if b is None else literal(b).text for b in (field.low, field.high))
    return f"({field.name!r}, {literal(field.factor).text}, {low}, {high})"


def _tuple(parts: list[str]) -> str:
    return f"({', '.join(parts)}{',' if len(parts) == 1 else ''})"


def _indented(lines: list[str]) -> list[str]:
    return [f"    {line}" for line in lines]
