"""Random wirings: directed acyclic graphs of every shape that the network language can express.

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
    Contract,
    Module,
    Program,
    Robot,
    Sensor,
    TransferFunction,
    Use,
    Wire,
    Wiring,
)
from colony.ir.types import BOOL, DIMENSIONLESS
from colony.text.wording import duration_text
from colony.verify.testing.frames import Choices

WINDOWS_NS = (0, 0, 100_000_000, 50_000_000, 150_000_000, 1)
"""Time constants of drawn networks: on frame boundaries, where off-by-one errors show."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Port:
    """A module or wire, and the actuators (None for nothing) that its output may command."""

    name: str
    actuators: frozenset[str | None]


class Wirings:
    """A generator of wirings over a growing list of ports. Mutable: `add` extends the list."""

    def __init__(
        self, choices: Choices, ports: Sequence[Port], windows_ns: Sequence[int] = WINDOWS_NS
    ) -> None:
        self.choices = choices
        self.ports = list(ports)
        self.windows_ns = windows_ns
        self._previous = ""

    def commanding(self, actuator: str | None) -> list[Port]:
        """Return the ports whose output always commands `actuator`."""
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

    def _another(self, ports: Sequence[Port]) -> Port:
        """Return one of `ports`, mostly not the previous one: a module wired to itself tests nothing."""
        others = [p for p in ports if p.name != self._previous] or list(ports)
        port = self.choices.pick(ports if self.choices.one_in(6) else others)
        self._previous = port.name
        return port

    def draw(self, passing: Sequence[Port], depth: int) -> Wiring:
        """Draw a wiring whose outputs come from the ports `passing`; inhibiting operands may be any port."""
        kind = self.choices.up_to(7) if depth > 0 else 0
        if kind <= 1:
            return Use(name=self._another(passing).name)
        relation: Literal["suppresses", "inhibits"] = "suppresses" if kind <= 5 else "inhibits"
        count = self.choices.between(2, 3)
        # The latest first: they are rarely part of what they inhibit, which would then never be active.
        inhibiting = self.ports[::-1]
        operands = [
            self.draw(passing if relation == "suppresses" or i == count - 1 else inhibiting, depth - 1)
            for i in range(count)
        ]
        return Chain(
            relation=relation,
            operands=tuple(operands),
            windows_ns=tuple(self.choices.pick(self.windows_ns) for _ in range(count - 1)),
        )


def draw_wires(wirings: Wirings, actuators: Sequence[str], max_wires: int, depth: int) -> list[Wire]:
    """Draw up to `max_wires` named wires, each for one actuator, and one that drives each actuator."""
    wires: list[Wire] = []
    for i in range(wirings.choices.mostly_large(0, max_wires)):
        among = wirings.commanding(wirings.choices.pick(actuators))
        if among:
            wire = Wire(name=f"w{i}", wiring=wirings.draw(among, depth))
            wirings.add(wire.name, wire.wiring)
            wires.append(wire)
    for actuator in actuators:
        among = wirings.commanding(actuator)
        if among:
            # The latest wires first: the simplest choice then uses everything drawn before.
            wiring = wirings.draw(list(reversed(among)), depth)
            wires.append(Wire(name=actuator, wiring=wiring, actuator=actuator))
    return wires


def draw_network(choices: Choices, max_modules: int, max_wires: int) -> Program:
    """Draw a program; see `tests.drawn.strategies.networks`."""
    actuators = ("drive", "arm")[: choices.between(1, 2)]
    count = choices.mostly_large(1, max_modules)
    modules = tuple(_module(choices, i, (*actuators, *actuators, None)) for i in range(count))
    ports = [Port(name=m.name, actuators=frozenset({m.actuator})) for m in modules]
    wires = draw_wires(Wirings(choices, ports), actuators, max_wires, 2)
    observed = [m.name for m in modules] + [w.name for w in wires if w.actuator is None]
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
        contracts=tuple(_inactivity(name) for name in observed),
    )


def _module(choices: Choices, i: int, actuators: Sequence[str | None]) -> Module:
    """Draw a module whose predicate is the sensor `p<i>`, and which commands its own number."""
    actuator, failsafe = choices.pick(actuators), choices.pick((False, False, True))
    number = Constant(type=DIMENSIONLESS, value=float(i + 1))
    return Module(
        name=f"m{i}",
        failsafe=failsafe,
        when=SensorValue(type=BOOL, name=f"p{i}"),
        command=TransferFunction(actuator=actuator, fields=(number,)) if actuator else None,
    )


def _actuator(name: str) -> Actuator:
    return Actuator(
        name=name,
        fields=(ActuatorField(name="level", type=DIMENSIONLESS),),
        server="RServer",
        command=name,
        idle=(0.0,),
    )


def _inactivity(name: str) -> Contract:
    """Return a contract that is broken whenever `name` is active, so that activity shows in outcomes."""
    active = IsActive(type=BOOL, name=name)
    return Contract(
        name=f"{name}_is_inactive", expression=UnaryOperation(type=BOOL, operator=Unary.NOT, operand=active)
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
