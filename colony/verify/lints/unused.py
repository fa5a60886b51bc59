"""Sensors that nothing reads."""

from __future__ import annotations

from collections.abc import Iterator

from colony.ir import expression as ir
from colony.ir.program import Module, Program, PythonModule
from colony.text.diagnostics import Diagnostic, warning
from colony.verify.difference.content import nodes
from colony.verify.difference.sampling import expressions
from colony.verify.lints.case import Case


def told(case: Case) -> Iterator[Diagnostic]:
    """Of the sensors declared in the file with the network; a robot that is imported has others' too."""
    read = set(_read(case.program))
    for sensor in case.program.robot.sensors:
        if case.is_own(sensor.span) and sensor.name not in read:
            yield warning(
                "V028",
                sensor.span,
                f"nothing reads the sensor `{sensor.name}`",
                "leave it out, or use it",
            )


def _read(program: Program) -> Iterator[str]:
    for expression in _all(program):
        for node in nodes(expression):
            match node:
                case ir.SensorValue(name=name):
                    yield name
                case ir.Fresh(name=name, derived=False):
                    yield name
                case _:
                    pass


def _all(program: Program) -> Iterator[ir.Expression]:
    yield from expressions(program)
    for module in program.modules:
        match module:
            case PythonModule(reads=reads):
                yield from (r.expression for r in reads)
            case Module():
                pass
    for limit in program.limits:
        yield limit.bound
        yield from () if limit.condition is None else (limit.condition,)
    yield from (c.expression for c in program.contracts)
