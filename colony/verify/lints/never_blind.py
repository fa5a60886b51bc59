"""Lint of failsafe modules that missing sensors do not make blind."""

from __future__ import annotations

from collections.abc import Iterator

from colony.ir import expression as ir
from colony.ir.program import Module
from colony.ir.walk import expressions_of
from colony.text.diagnostics import Diagnostic, note
from colony.text.wording import quoted
from colony.verify.lints.case import Case


def findings(case: Case) -> Iterator[Diagnostic]:
    """Yield a note for each failsafe module that is never blind, or only where a server has no value at all.

    A reading grows too old only by its sensor's `within`. A module in Python is blind also without an answer,
    so nothing is said of it.
    """
    sensors = {s.name: s for s in case.program.robot.sensors}
    for name, module in case.own_modules.items():
        needed = sorted(case.contents.needs(module))
        if not module.failsafe or any(sensors[s].within_ns is not None for s in needed):
            continue
        if needed:
            names, has, its = quoted(needed), *(("has", "its") if len(needed) == 1 else ("have", "their"))
            message = (
                f"`{name}` is failsafe, but goes blind only where {names} {has} no value at all: "
                f"{its} readings never get too old"
            )
            hint = f"declare {names} with a `within`"
        else:
            message = f"`{name}` is failsafe, but never goes blind: nothing that it needs can be missing"
            hint = _hint(case, module)
        yield note("V032", module.span, message, hint)


def _hint(case: Case, module: Module) -> str:
    """Return advice on a module that needs no sensor."""
    with_default = {s.name for s in case.program.robot.sensors if s.default is not None}
    read = {x.name for x in case.reads(*expressions_of(module)) if isinstance(x, ir.SensorValue)}
    names = sorted(with_default & read)
    if not names:
        return "remove `failsafe`"
    has = "has a default, which stands" if len(names) == 1 else "have defaults, which stand"
    advice = f"ask `fresh({names[0]})`, or remove `failsafe`"
    return f"{quoted(names)} {has} in for a missing reading: {advice}"
