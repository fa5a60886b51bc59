"""Random wirings as directed acyclic graphs, of every shape that the network language can express.

Wires are drawn one after the other, each over the modules and wires before it. So sharing (fan-out) is common
and cycles are impossible.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from colony.ir.expression import Constant, IsActive, SensorValue, Unary, UnaryOperation
from colony.ir.program import (
    Actuator,
    ActuatorField,
    Chain,
    Command,
    Contract,
    Module,
    Program,
    Robot,
    Sensor,
    Use,
    Wire,
    Wiring,
)
from colony.ir.types import BOOL, DIMENSIONLESS
from colony.text.wording import duration_text
from colony.verify.testing.drawing import Choices

WINDOWS_NS = (0, 0, 100_000_000, 50_000_000, 150_000_000, 1)
"""Time constants of drawn networks: on frame boundaries, where off-by-one errors show."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Port:
    """A module or wire, and the actuators (None: nothing) of the commands that may be on its output."""

    name: str
    actuators: frozenset[str | None]


class Wirings:
    """A drawer of wirings over a growing list of ports. Mutable: `add` extends it."""

    def __init__(
        self, choices: Choices, ports: Sequence[Port], windows_ns: Sequence[int] = WINDOWS_NS
    ) -> None:
        self.choices = choices
        self.ports = list(ports)
        self.windows_ns = windows_ns
        self._before = ""

    def commanding(self, actuator: str | None) -> list[Port]:
        """Return the ports whose every output commands `actuator`."""
        return [p for p in self.ports if p.actuators == {actuator}]

    def add(self, name: str, wiring: Wiring) -> None:
        """Add a wiring under a name."""
        self.ports.append(Port(name=name, actuators=self.outputs(wiring)))

    def outputs(self, wiring: Wiring) -> frozenset[str | None]:
        """Return the actuators that the modules of a wiring command."""
        match wiring:
            case Use(name=name):
                return next(p.actuators for p in self.ports if p.name == name)
            case Chain(relation="inhibits", operands=operands):
                return self.outputs(operands[-1])
            case Chain(operands=operands):
                return frozenset[str | None]().union(*map(self.outputs, operands))

    def _another(self, among: Sequence[Port]) -> Port:
        """Return one of `among`, mostly not the last one: a module wired to itself tests nothing."""
        others = [p for p in among if p.name != self._before] or list(among)
        port = self.choices.one(among if self.choices.rarely(6) else others)
        self._before = port.name
        return port

    def draw(self, among: Sequence[Port], depth: int) -> Wiring:
        """Draw a wiring whose outputs come from ports in `among`; what only inhibits may be any port."""
        kind = self.choices.upto(7) if depth > 0 else 0
        if kind <= 1:
            return Use(name=self._another(among).name)
        relation: Literal["suppresses", "inhibits"] = "suppresses" if kind <= 5 else "inhibits"
        count = self.choices.between(2, 3)
        inhibiting = self.ports[
            ::-1
        ]  # the latest first: rarely a part of what they inhibit, which would never be active
        operands = [
            self.draw(among if relation == "suppresses" or i == count - 1 else inhibiting, depth - 1)
            for i in range(count)
        ]
        return Chain(
            relation=relation,
            operands=tuple(operands),
            windows_ns=tuple(self.choices.one(self.windows_ns) for _ in range(count - 1)),
        )


def draw_wires(wirings: Wirings, actuators: Sequence[str], most: int, depth: int) -> list[Wire]:
    """Draw up to `most` named wires, each for one actuator, and one that drives each actuator."""
    wires: list[Wire] = []
    for i in range(wirings.choices.several(0, most)):
        among = wirings.commanding(wirings.choices.one(actuators))
        if among:
            wire = Wire(name=f"w{i}", wiring=wirings.draw(among, depth))
            wirings.add(wire.name, wire.wiring)
            wires.append(wire)
    for actuator in actuators:
        among = wirings.commanding(actuator)
        if among:
            # The latest wires first: what is drawn simplest then uses all that was drawn before.
            wiring = wirings.draw(list(reversed(among)), depth)
            wires.append(Wire(name=actuator, wiring=wiring, actuator=actuator))
    return wires


def draw_network(choices: Choices, max_modules: int, max_wires: int) -> Program:
    """Draw a program; see `colony.verify.testing.strategies.networks`."""
    actuators = ("drive", "arm")[: choices.between(1, 2)]
    count = choices.several(1, max_modules)
    modules = tuple(_module(i, choices.one((*actuators, *actuators, None))) for i in range(count))
    ports = [Port(name=m.name, actuators=frozenset({m.actuator})) for m in modules]
    wires = draw_wires(Wirings(choices, ports), actuators, max_wires, 2)
    watched = [m.name for m in modules] + [w.name for w in wires if w.actuator is None]
    return Program(
        robot=Robot(
            name="robot",
            sensors=tuple(
                Sensor(name=f"p{i}", type=BOOL, server="DServer", field=f"p{i}") for i in range(count)
            ),
            actuators=tuple(_actuator(name) for name in actuators),
        ),
        modules=modules,
        wires=tuple(wires),
        contracts=tuple(_silence(name) for name in watched),
    )


def _module(i: int, actuator: str | None) -> Module:
    """Return a module that is applicable where the sensor `p<i>` is true, and commands its own number."""
    number = Constant(type=DIMENSIONLESS, value=float(i + 1))
    return Module(
        name=f"m{i}",
        when=SensorValue(type=BOOL, name=f"p{i}"),
        command=Command(actuator=actuator, fields=(number,)) if actuator else None,
    )


def _actuator(name: str) -> Actuator:
    return Actuator(
        name=name,
        fields=(ActuatorField(name="level", type=DIMENSIONLESS),),
        server="RServer",
        command=name,
        idle=(0.0,),
    )


def _silence(name: str) -> Contract:
    """Return a contract that is broken where `name` is active, so that activity shows in outcomes."""
    active = IsActive(type=BOOL, name=name)
    return Contract(
        name=f"{name}_is_silent", expression=UnaryOperation(type=BOOL, operator=Unary.NOT, operand=active)
    )


def wiring_text(wiring: Wiring, nested: bool = False) -> str:
    """Return the text of a wiring."""
    match wiring:
        case Use(name=name):
            return name
        case Chain(relation=relation, operands=operands, windows_ns=windows_ns):
            text = wiring_text(operands[0], nested=True)
            for operand, window_ns in zip(operands[1:], windows_ns, strict=True):
                window = f"[{duration_text(window_ns)}]" if window_ns else ""
                text += f" {relation}{window} {wiring_text(operand, nested=True)}"
            return f"({text})" if nested else text
