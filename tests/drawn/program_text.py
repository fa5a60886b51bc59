"""Whole programs as source text: a robot, derived values, modules, wiring, limits and contracts.

Declarations are drawn and written in an order in which each may read those before it.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

from colony.ir.types import BOOL, DEGREES, DIMENSIONLESS, Array, Enum, Quantity, Scalar, Type
from colony.text.units import ANGLE, LENGTH, NUMBER, TIME, Dimension
from colony.verify.testing.frames import Choices
from tests.drawn.bearings import draw_bearings
from tests.drawn.expressions import Expressions
from tests.drawn.networks import Port, Wirings, draw_wires, wiring_text
from tests.drawn.scope import LITERALS, SPEED, TURN_RATE, Named, Scope

MOOD = Enum("mood", (("calm", 0.0), ("alert", 67.0), ("lost", -2.5)))
WORDS = ("resting", "going", "stuck")

UNITS: dict[Dimension, tuple[str, ...]] = {
    NUMBER: ("number",),
    LENGTH: ("mm", "m", "cm", "inch"),
    TIME: ("s", "ms"),
    ANGLE: ("deg", "rad"),
}

WINDOWS_NS = (0, 0, 100_000_000, 50_000_000, 150_000_000)


def draw_text(choices: Choices, python: bool, sequence: bool = False) -> str:
    """Draw a text, with `sequence` one that has a sequence; see `tests.drawn.strategies.texts`."""
    return _Text(choices, python, sequence).program()


Constants = dict[Dimension, tuple[str, ...]]


def _with_constant(constants: Constants, dimension: Dimension, name: str) -> Constants:
    """Return `constants` with a param added."""
    return {**constants, dimension: (*constants.get(dimension, ()), name)}


class _Text:
    """A program being written. Mutable."""

    def __init__(self, choices: Choices, python: bool, has_sequence: bool) -> None:
        self.choices = choices
        self.python = python
        self.has_sequence = has_sequence
        self.lines: list[str] = []
        self.scope = Scope(enums=(MOOD,))
        self.light = False
        self.probes = choices.mostly_large(0, 2)
        self.probe_types: list[Quantity] = []  # what the probes send
        self.ports: list[Port] = []
        self.parts: list[Named] = []  # `module.name`, for contracts
        self.phases: Sequence[str] = ()
        self.params: Constants = {}
        self.own_params: dict[str, Dimension] = {}  # `module.name`
        self.roles = False
        self.tasks: list[Port] = []  # of the sequence, which has wires among the ports

    def program(self) -> str:
        self.robot()
        self.file_level()
        for i in range(self.choices.mostly_large(1, 4)):
            self.module(i)
        self.variations()
        if self.has_sequence or self.choices.one_in(3):
            self.sequence()
        self.watches()
        wires = self.network()
        self.limits()
        self.contracts(wires)
        return "\n".join(self.lines) + "\n"

    def add(self, line: str) -> None:
        self.lines.append(line)

    def write(self, of: Type, depth: int, scope: Scope | None = None) -> str:
        return Expressions(self.choices, scope or self.scope).any_value(of, depth)

    def readable(self, text: str, type_: Type, fresh: bool = False) -> None:
        self.scope = self.scope.with_names(Named(text=text, type=type_, fresh=fresh))

    # --- the robot -------------------------------------------------------------------------------

    def robot(self) -> None:
        self.add("enum mood { calm = 0, alert = 67, lost = -2.5 }")
        self.add("robot drawn {")
        self.add(f"  frame {self.choices.pick(('50', '100', '20'))} ms")
        self.add("  sensor b0 : bool from DServer.b0")
        self.readable("b0", BOOL, fresh=True)
        for i in range(self.choices.mostly_large(0, 4)):
            self.sensor(f"d{i}")
        velocity = self.choices.pick(("mm/s", "m/s", "ft/s"))
        turn = self.choices.pick(("deg/s", "rad/s", "rad/min"))
        fields = f"velocity : {velocity}{self.range(4)}, turn : {turn}{self.range(2)}"
        self.add(f"  actuator drive {{ {fields} }}")
        moving = "range" not in fields and self.choices.one_in(2)
        idle = "velocity = -10 mm/s, turn = 1 rad/s" if moving else "velocity = 0, turn = 0"
        self.add(f"    to RServer.drive idle drive({idle}){self.on_loss()}")
        self.light = self.choices.one_in(2)
        if self.light:
            self.add(f"  actuator light {{ level : number{self.range(3)}, on : bool, mood : mood }}")
            idle = self.choices.pick(("light(level = 1, on = false, mood = mood.lost)", "hold"))
            self.add(f"    to DServer.Light idle {idle}{self.on_loss()}")
        for i in range(self.probes):
            dimension = self.choices.pick([d for d in UNITS if d.time >= 0])
            unit = self.choices.pick(UNITS[dimension])
            self.add(f"  actuator probe{i} {{ seen : {unit} }} to DServer.Probe{i} idle hold")
            self.probe_types.append(Quantity(dimension))
        self.add("}")
        if self.choices.one_in(6):
            self.sent_before()

    def sent_before(self) -> None:
        """Let everything read what one or two fields of actuators were given in the frame before.

        Sometimes also what modules did in it: the first, which is written below, and all above what reads it.
        """
        fields: list[tuple[str, Type]] = [
            ("drive.velocity", Quantity(SPEED)),
            ("drive.turn", Quantity(TURN_RATE)),
        ]
        if self.light:
            fields += [("light.level", DIMENSIONLESS), ("light.on", BOOL), ("light.mood", MOOD)]
        fields += [(f"probe{i}.seen", type_) for i, type_ in enumerate(self.probe_types)]
        for field, type_ in dict(self.choices.pick(fields) for _ in range(2)).items():
            self.readable(f"last.{field}", type_, fresh=True)
        self.roles = self.choices.one_in(2)
        self.role_of("m0", "drive")

    def role_of(self, module: str, actuator: str | None) -> None:
        """Let everything below read what a module did in the frame before."""
        if self.roles and actuator is not None:
            self.readable(f"(last.{actuator} by {module})", BOOL)
            self.readable(f"(last.{module} is active)", BOOL)

    def range(self, high: int) -> str:
        """Return a range in the declared unit, or nothing."""
        if not self.choices.one_in(2):
            return ""
        return f" range {self.choices.pick(('-1', '0', '-0.5'))} .. {self.choices.between(1, high)}"

    def on_loss(self) -> str:
        return self.choices.pick(("", " on_loss stop", " on_loss degrade"))

    def sensor(self, name: str) -> None:
        kind = self.choices.up_to(6)
        scalar: Scalar
        if kind <= 2:
            scalar, unit = BOOL, "bool"
        elif kind == 6:
            scalar, unit = MOOD, "mood"
        else:
            dimension = self.choices.pick([*UNITS])
            scalar, unit = Quantity(dimension), self.choices.pick(UNITS[dimension])
        size = self.choices.between(1, 5) if self.choices.one_in(2) else 0
        if size and self.choices.one_in(6):
            size = self.choices.between(6, 24)
        bearing, bearings = "", None
        if size and not self.choices.one_in(3):
            text, bearings = draw_bearings(self.choices, size)
            bearing = f" {text}"
        extra = self.range(9) if isinstance(scalar, Quantity) else ""
        if self.choices.one_in(3):
            default = {"bool": "true", "mood": "mood.alert"}.get(unit, "1")
            extra += f" default {default}"
        shape = f"[{size}]" if size else ""
        within = self.choices.pick(("", " within 300 ms"))
        self.add(f"  sensor {name}{shape} : {unit}{bearing}{extra} from DServer.{name}{within}")
        self.readable(name, Array(scalar, size, bearings) if size else scalar, fresh=True)
        if bearings is not None and self.choices.one_in(2):  # an angle to look along
            self.add(f"  sensor {name}a : deg from DServer.{name}a")
            self.readable(f"{name}a", DEGREES, fresh=True)

    # --- derived values --------------------------------------------------------------------------

    def file_level(self) -> None:
        """Write params, states, lets and a machine; each may read those above it."""
        for i in range(self.choices.up_to(1)):
            self.param(f"c{i}", "")
        states = []
        for i in range(self.choices.up_to(2)):
            scalar = Expressions(self.choices, self.scope).any_scalar()
            self.add(self.state(f"s{i}", scalar))
            self.readable(f"s{i}", scalar)
            states.append((f"s{i}", scalar))
        self.lets(0, self.choices.up_to(2))
        if self.choices.one_in(3):
            self.machine()
        self.lets(2, self.choices.up_to(1))
        for name, scalar in states:
            if not self.choices.one_in(5):
                self.add(f"next {name} = {self.write(scalar, 2)}")

    def param(self, name: str, indent: str) -> tuple[str, Dimension]:
        dimension = self.choices.pick([*LITERALS])
        self.add(f"{indent}param {name} = {Expressions(self.choices, self.scope).literal(dimension)}")
        if not indent:
            self.params = _with_constant(self.params, dimension, name)
            self.scope = replace(self.scope, constants=self.params)
        return name, dimension

    def state(self, name: str, of: Scalar) -> str:
        """Return a state's declaration; its type is written or inferred from its initial value."""
        if isinstance(of, Quantity):
            declared = {SPEED: "mm/s", TURN_RATE: "deg/s"}.get(of.dimension) or UNITS[of.dimension][0]
            initial = Expressions(self.choices, Scope()).literal(of.dimension)
        else:
            declared = "bool" if of == BOOL else str(of)
            initial = "false" if of == BOOL else f"{of}.calm"
        typed = f" : {declared}" if self.choices.one_in(2) else ""
        return f"state {name}{typed} = {initial}"

    def lets(self, first: int, count: int) -> None:
        for i in range(first, first + count):
            text, type_ = self.some_value(3)
            self.add(f"let g{i} = {text}")
            self.readable(f"g{i}", type_, fresh=True)

    def some_value(self, depth: int) -> tuple[str, Type]:
        """Draw a scalar or, less often, an array."""
        writer = Expressions(self.choices, self.scope)
        arrays = writer.arrays()
        if not arrays or not self.choices.one_in(3):
            scalar = writer.any_scalar()
            return writer.scalar(scalar, depth), scalar
        looking = writer.looking(depth) if self.choices.one_in(2) else None
        if looking is not None:
            return looking.text, looking.type
        type_ = replace(self.choices.pick(arrays).type, bearings=None)  # not known of what is drawn
        return writer.any_value(type_, depth), type_

    def machine(self) -> None:
        phases = WORDS[: self.choices.between(2, 3)]
        transitions = []
        # Each phase is the target of a transition: a machine has only the phases that it names.
        for target in (*phases[1:], *(self.choices.pick(phases) for _ in range(self.choices.up_to(2)))):
            sources = [p for p in phases if p != target]
            source = "any" if self.choices.one_in(3) else self.choices.pick(sources)
            failsafe = self.failsafe()
            transitions.append(f"  {failsafe}{source} -> {target} when {self.write(BOOL, 2)}")
        self.add(f"machine phase {{\n  start {phases[0]}")
        self.lines.extend(transitions)
        self.add("}")
        members = tuple((p, float(i)) for i, p in enumerate(phases))
        self.readable("phase", Enum("phase", members, "machine"))
        self.phases = phases

    # --- modules ---------------------------------------------------------------------------------

    def module(self, i: int) -> None:
        if self.python and i > 0 and self.choices.one_in(6):
            self.python_module(f"m{i}")
            return
        name, outer = f"m{i}", self.scope
        actuator = self.choices.pick(("drive", "drive", *(["light"] * self.light), None)) if i else "drive"
        self.add(f"{self.failsafe()}module {name} {{")
        members: list[Named] = []
        if self.choices.one_in(3):
            param, dimension = self.param("gain", "  ")
            self.scope = replace(self.scope, constants=_with_constant(self.params, dimension, param))
            self.own_params[f"{name}.gain"] = dimension
        members += self.own_memory(name)
        self.add(f"  when {self.write(BOOL, self.choices.pick((3, 0)))}")
        if actuator is not None:
            self.add(f"  do {self.command(actuator)}")
        self.add("}")
        self.scope = outer
        self.parts += members
        self.ports.append(Port(name=name, actuators=frozenset({actuator})))
        if i > 0:
            self.role_of(name, actuator)

    def failsafe(self) -> str:
        return self.choices.pick(("", "", "failsafe "))

    def own_memory(self, name: str) -> list[Named]:
        """Write lets and a state of a module, with the same names in every module; return them."""
        members: list[Named] = []
        for i in range(self.choices.up_to(2)):
            text, type_ = self.some_value(2)
            self.add(f"  let x{i} = {text}")
            self.readable(f"x{i}", type_)
            members.append(Named(text=f"{name}.x{i}", type=type_))
        if self.choices.one_in(3):
            scalar = Expressions(self.choices, self.scope).any_scalar()
            self.add(f"  {self.state('y', scalar)}")
            self.readable("y", scalar)
            members.append(Named(text=f"{name}.y", type=scalar))
            self.add(f"  next y = {self.write(scalar, 2)}")
        return members

    def command(self, actuator: str) -> str:
        if actuator == "drive":
            velocity, turn = self.write(Quantity(SPEED), 2), self.write(Quantity(TURN_RATE), 2)
            return f"drive(velocity = {velocity}, turn = {turn})"
        level, on, mood = self.write(DIMENSIONLESS, 2), self.write(BOOL, 1), self.write(MOOD, 1)
        return f"light(mood = {mood}, level = {level}, on = {on})"

    def python_module(self, name: str) -> None:
        path = "tests.drawn.python_modules:ErraticModule"
        self.add(f'{self.failsafe()}module {name} from python "{path}" {{')
        self.add(f"  param seed = {self.choices.up_to(7)}")
        names = [n.text for n in self.scope.names if " " not in n.text]
        reads = list(dict.fromkeys(self.choices.pick(names) for _ in range(2)))
        self.add(f"  reads {', '.join(reads)}")
        self.add("  commands drive")
        if self.choices.one_in(2):
            self.add(f"  rate {self.choices.pick((100, 50, 120))} ms")
        self.add("}")
        self.ports.append(Port(name=name, actuators=frozenset({"drive"})))
        self.role_of(name, "drive")

    def variations(self) -> None:
        """Write a module derived from another, sometimes with an overridden param."""
        originals = [
            i
            for i, line in enumerate(self.lines)
            if line.removeprefix("failsafe ").startswith("module m") and "{" in line
        ]
        for start in originals[:1]:
            if not self.choices.one_in(3) or "python" in self.lines[start]:
                continue
            name = self.lines[start].removeprefix("failsafe ").split()[1]
            dimension = self.own_params.get(f"{name}.gain")
            overrides = ""
            if dimension is not None:
                overrides = f"(gain = {Expressions(self.choices, self.scope).literal(dimension)})"
            self.add(f"{self.failsafe()}module other = {name}{overrides}")
            actuators = next(p.actuators for p in self.ports if p.name == name)
            self.ports.append(Port(name="other", actuators=actuators))

    def sequence(self) -> None:
        """Write a sequence of tasks that are derived from modules above; what is below reads its phases."""
        bases = [line.split()[1] for line in self.lines if re.match(r"module m\d+ \{", line)]
        commanding = {p.name: p.actuators for p in self.ports if None not in p.actuators}
        bases = [name for name in bases if name in commanding]
        if not bases:
            self.add("module m9 { when true do drive(velocity = 1 mm/s, turn = 0) }")
            bases, commanding = ["m9"], {"m9": frozenset({"drive"})}
        count = self.choices.between(1, 3)
        tasks, ends = [f"t{i}" for i in range(count)], ["failed", "done"]
        waits = self.choices.one_in(2)
        when = f" when {self.write(BOOL, 1)}" if waits else ""
        self.add(f"sequence chore{when}{self.choices.pick((' keep', ' restart', ''))} {{")
        actuators: dict[str, str] = {}
        failures: list[str] = []
        for task in tasks:
            base = self.choices.pick(bases)
            dimension = self.own_params.get(f"{base}.gain")
            gain = "" if dimension is None else Expressions(self.choices, Scope()).literal(dimension)
            arguments = f"(gain = {gain})" if gain and self.choices.one_in(2) else ""
            until = f" until {self.write(BOOL, self.choices.pick((2, 0)))}"
            if not self.choices.one_in(4):
                failure = self.choices.pick((*tasks, *ends))
                if failure == task and "false" in until:  # it may never end
                    failure = "done"
                failures += [failure] if failure == "failed" else []
                until += f" within {self.choices.pick(('50 ms', '0.2 s', '120 ms'))} else {failure}"
            elif "false" in until:  # it may never be true
                until += " within 300 ms else done"
            self.add(f"  {task} = {base}{arguments}{until}")
            (actuators[task],) = commanding[base]  # type: ignore[misc]
            self.role_of(f"chore.{task}", actuators[task])
            self.tasks.append(Port(name=f"chore.{task}", actuators=frozenset({actuators[task]})))
        self.add("}")
        self.ports += [
            Port(name=f"chore.{name}", actuators=frozenset({name}))
            for name in dict.fromkeys(actuators.values())
        ]
        phases = ["waiting"] * waits + tasks + ["done", *failures[:1]]
        members = tuple((p, float(i)) for i, p in enumerate(phases))
        self.readable("chore", Enum("chore", members, "machine"))
        self.lines += [f"contract not_{p}: chore != chore.{p}" for p in phases]

    def watches(self) -> None:
        """Write modules that command the values of expressions, so that these are compared bit for bit."""
        for i, of in enumerate(self.probe_types):
            self.add(f"module watch{i} {{\n  when true\n  do probe{i}(seen = {self.write(of, 3)})\n}}")

    # --- network, limits, contracts --------------------------------------------------------------

    def network(self) -> list[str]:
        """Write the network, its wires in the order drawn or reversed, and return the names of its wires."""
        actuators = ["drive", *(["light"] * self.light)]
        wirings = Wirings(self.choices, self.ports, WINDOWS_NS)
        wires = draw_wires(wirings, actuators, 3, 2)
        lines = [f"  {wire.name} = {wiring_text(wire.wiring)}" for wire in wires]
        lines += [f"  probe{i} = watch{i}" for i in range(self.probes)]
        if self.choices.one_in(2):
            lines.reverse()
        self.lines += ["network {", *lines, "}"]
        return [wire.name for wire in wires if wire.actuator is None]

    def limits(self) -> None:
        fields = [("drive.velocity", SPEED), ("drive.turn", TURN_RATE), ("drive.velocity", SPEED)]
        fields += [("light.level", NUMBER)] * (4 * self.light)
        for _ in range(self.choices.up_to(2)):
            field, dimension = self.choices.pick(fields)
            bound, relation = self.write(Quantity(dimension), 2), self.choices.pick(("<=", ">="))
            condition = f" when {self.write(BOOL, 2)}" if self.choices.one_in(2) else ""
            self.add(f"limit {field} {relation} {bound}{condition}")

    def contracts(self, wires: Sequence[str]) -> None:
        self.drawn_contracts(wires)
        for phase in self.phases[1:]:  # which phase it is shows in every frame, whatever reads it
            self.add(f"contract not_{phase}: phase != phase.{phase}")

    def drawn_contracts(self, wires: Sequence[str]) -> None:
        if not (count := self.choices.up_to(3)):
            return
        modules = [*(p for p in self.ports if "." not in p.name), *self.tasks]
        names_of_parts = [p.name for p in (*self.ports, *self.tasks)]
        conditions = [f"({name} is active)" for name in (*names_of_parts, *wires)]
        for port in modules:
            conditions += [f"({actuator} by {port.name})" for actuator in port.actuators if actuator]
        for actuator in ("drive", *(["light"] * self.light)):
            conditions += [f"({actuator} is commanded)", f"({actuator} is idle)"]
        names = [*self.parts, Named(text="drive.velocity", type=Quantity(SPEED))]
        names.append(Named(text="drive.turn", type=Quantity(TURN_RATE)))
        if self.light:
            names += [Named(text="light.on", type=BOOL), Named(text="light.mood", type=MOOD)]
            names.append(Named(text="light.level", type=DIMENSIONLESS))
        constants = self.params
        for name, dimension in self.own_params.items():
            constants = _with_constant(constants, dimension, name)
        scope = Scope(
            names=(*self.scope.names, *names),
            enums=(MOOD,),
            contract_conditions=tuple(conditions),
            constants=constants,
        )
        for i in range(count):
            self.add(f"contract k{i}: {self.write(BOOL, 3, scope)}")
        if self.light and self.choices.one_in(2):
            self.add(f"contract level: light.level <= {self.write(DIMENSIONLESS, 1, scope)} or light.on")
