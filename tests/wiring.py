"""Programs from a few lines of wiring: `NAME = WIRING` as in the language, without a robot or modules.

What no line defines is a module; the names in ACTUATORS are actuators.
"""

from __future__ import annotations

import re

from colony.ir.expression import Constant
from colony.ir.program import (
    Actuator,
    ActuatorField,
    AnyModule,
    Chain,
    Module,
    Program,
    Robot,
    TransferFunction,
    Use,
    Wire,
    Wiring,
)
from colony.ir.types import BOOL, DIMENSIONLESS

ACTUATORS = ("drive", "arm")
_TOKEN = re.compile(r"[A-Za-z_]\w*|\[\d+ ms\]|[()=]")


def program(text: str) -> Program:
    """The program that the lines describe; actuators only where they are driven."""
    wires = []
    for line in filter(None, map(str.strip, text.splitlines())):
        name, _, wiring = line.partition("=")
        tokens = _TOKEN.findall(wiring)
        actuator = name.strip() if name.strip() in ACTUATORS else None
        wires.append(Wire(name=name.strip(), wiring=_wiring(tokens), actuator=actuator))
    defined = {wire.name for wire in wires}
    used = dict.fromkeys(name for wire in wires for name in _names(wire.wiring) if name not in defined)
    driven = [name for name in ACTUATORS if name in defined]
    return Program(
        robot=Robot(name="rome", actuators=tuple(_actuator(name) for name in driven)),
        modules=tuple(_module(name) for name in used),
        wires=tuple(wires),
    )


def _wiring(tokens: list[str]) -> Wiring:
    """Consume tokens up to the closing parenthesis or the end."""
    operands: list[Wiring] = []
    windows: list[int] = []
    relation = ""
    while tokens and tokens[0] != ")":
        token = tokens.pop(0)
        if token in ("suppresses", "inhibits"):
            assert relation in ("", token), "mixed relations need parentheses"
            relation = token
            windows.append(int(tokens.pop(0)[1:-4]) * 1_000_000 if tokens[0].startswith("[") else 0)
        elif token == "(":
            operands.append(_wiring(tokens))
            tokens.pop(0)
        else:
            operands.append(Use(name=token))
    if len(operands) == 1:
        return operands[0]
    assert relation == "suppresses" or relation == "inhibits"
    return Chain(relation=relation, operands=tuple(operands), windows_ns=tuple(windows))


def _names(wiring: Wiring) -> list[str]:
    if isinstance(wiring, Use):
        return [wiring.name]
    return [name for operand in wiring.operands for name in _names(operand)]


def _actuator(name: str) -> Actuator:
    field = ActuatorField(name="velocity", type=DIMENSIONLESS)
    return Actuator(name=name, fields=(field,), server="RServer", command=name, idle=(0.0,))


def _module(name: str) -> AnyModule:
    command = TransferFunction(actuator="drive", fields=(Constant(type=DIMENSIONLESS, value=0.0),))
    return Module(name=name, when=Constant(type=BOOL, value=True), command=command)
