"""What a page shows of one frame: `PageFrame`, made of a frame and the interpreter that stepped over it.

The same snapshots come from recordings and from robots that run. Their members are in the order of the
program's `Scene`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import IntFlag
from typing import Literal

from colony.compile.network import ModuleLeaf, Network, Suppressor
from colony.compile.passes.elaborate import elaborate
from colony.ir.frame import Frame, Outcome, Reading, is_connection
from colony.ir.memory import window_cell
from colony.ir.program import Actuator, Program, in_declared_units
from colony.ir.types import ScalarValue
from colony.ir.walk import wiring_graph
from colony.runtime.frames.run_frame import HeardCommand, RunFrame
from colony.runtime.protocol.deployment import tunables_of
from colony.runtime.protocol.messages import Fate, Tick, Verdict
from colony.verify.reference.interpreter import Interpreter
from colony.watch.scene import SensorScene, pose_sensors, scene_of, shown_sensors, shown_states

# --- snapshot ------------------------------------------------------------------------------------------


DECIMALS = 4
"""Decimals of values around the robot, which pages get by the hundreds."""


ModuleState = Fate | Literal["active", "unknown"]
"""A client's fate; "active" or "inactive" for a module that commands nothing, "unknown" without memory."""

ContractState = Literal["held", "broken", "unknown"]

Cell = float | bool | None | tuple[float | bool | None, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class CommandSnapshot:
    """What an actuator was sent.

    Attributes:
        by: the module that won, if any.
        sent: the command in declared units, None if nothing was sent.
        low: the greatest lower bound of each field in this frame, None if there is none or it is unknown.
        high: the least upper bound of each field.
        fault: the reason why the idle command was sent.
        outside: the connection outside the network that commanded.
        hold: the reason why the network did not decide.
        is_decided: False if no verdict was received.
        heard: what another controller commanded, in declared units; None if that is not heard.
    """

    by: str | None
    sent: tuple[ScalarValue, ...] | None
    low: tuple[float | None, ...]
    high: tuple[float | None, ...]
    fault: str | None
    outside: str | None
    hold: str | None
    is_decided: bool
    heard: tuple[ScalarValue, ...] | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class PageFrame:
    """One frame.

    Attributes:
        k: number of the frame.
        t: time in seconds.
        sensors: the value of each sensor, None where it is missing.
        stale: indices of sensors that have a value which is too old, or faulty, so that it counts as missing.
        modules: the state of each module.
        active: nodes of the network that have an output.
        live: wires, as node and node or actuator, along which a command reached its actuator.
        windows: remaining seconds of each time constant that runs down, by node.
        commands: what each actuator was sent.
        contracts: the state of each contract.
        states: the value of each state, None if memory is unknown.
        pose: x and y in mm, and heading in degrees counterclockwise from north; None if it is unknown.
        late: clients that were late, lost or refused, and servers that are down.
        stopped_by: who stopped the robot in an emergency; "" for a stop without a name, None for no stop.
        is_restart: True if all memory restarted.
        is_known: True if the memory of the program is known.
        heard_broken: indices of the contracts that another controller broke.
    """

    k: int
    t: float
    sensors: tuple[Cell, ...]
    stale: tuple[int, ...]
    modules: tuple[ModuleState, ...]
    active: tuple[int, ...]
    live: tuple[tuple[int, int | str], ...]
    windows: Mapping[int, float]
    commands: tuple[CommandSnapshot, ...]
    contracts: tuple[ContractState, ...]
    states: tuple[float | bool | None, ...]
    pose: tuple[float, float, float] | None
    late: tuple[str, ...]
    stopped_by: str | None
    is_restart: bool
    is_known: bool
    heard_broken: tuple[int, ...] = ()


class SnapshotMaker:
    """Makes snapshots of the frames of a program. Holds what depends on the program alone.

    Args:
        program: the program.
    """

    def __init__(self, program: Program) -> None:
        self._program = program
        self._network = elaborate(program)
        self._paths = {window_cell(n.path[0], n.path[1:]): n.path for n in wiring_graph(program).nodes}
        self._sensors = scene_of(program, "", ()).sensors
        self._shown = shown_sensors(program)
        self._initial = {t.name: t.initial for t in tunables_of(program.robot)}
        self._pose = pose_sensors(program)
        self._actuators = {m.name: m.actuator for m in program.modules}

    def make(self, observed: RunFrame, outcome: Outcome | None, interpreter: Interpreter | None) -> PageFrame:
        """Return the snapshot of a frame.

        Args:
            observed: the frame.
            outcome: the outcome of the frame in the interpreter, None if memory is unknown.
            interpreter: the interpreter, which has stepped over the frame, None if memory is unknown.
        """
        program, frame = self._program, observed.frame
        outputs = () if interpreter is None else tuple(self._outputs(interpreter))
        readings = [frame.readings.get(s.name, self._initial.get(s.name)) for s in self._shown]
        stale = tuple(
            i
            for i, (s, reading) in enumerate(zip(self._shown, readings, strict=True))
            if reading is not None and interpreter is not None and not interpreter.is_read(s.name)
        )
        tick, verdicts = observed.tick, observed.verdicts
        holds = any(v.hold == "stopped" for v in verdicts.values())
        return PageFrame(
            k=tick.k,
            t=frame.t_ns / 1e9,
            sensors=tuple(_cell(s, x) for s, x in zip(self._sensors, readings, strict=True)),
            stale=stale,
            modules=tuple(self._module(m.name, verdicts, outcome, interpreter) for m in program.modules),
            active=tuple(i for i, output in enumerate(outputs) if output is not None),
            live=() if interpreter is None else tuple(_live(self._network, outputs, verdicts)),
            windows={} if interpreter is None else dict(self._windows(interpreter)),
            commands=tuple(
                _command(a, verdicts.get(a.name), interpreter, observed.heard.get(a.name))
                for a in program.robot.actuators
            ),
            contracts=tuple(_contract(c.name, outcome, interpreter) for c in program.contracts),
            states=tuple(
                None if interpreter is None else _number(interpreter.states[s.name])
                for s in shown_states(program)
            ),
            pose=self._pose_in(frame),
            late=tuple(_late(tick, verdicts)),
            stopped_by=tick.stopped.by if tick.stopped is not None else "" if holds else None,
            is_restart=observed.restart or frame.restarted,
            is_known=interpreter is not None,
            heard_broken=tuple(
                i for i, c in enumerate(program.contracts) if c.name in observed.heard_breaches
            ),
        )

    def _outputs(self, interpreter: Interpreter) -> Iterator[str | None]:
        """Yield the module whose output leaves each node of the network."""
        for node in self._network.nodes:
            if isinstance(node, ModuleLeaf):
                yield node.module if interpreter.is_active(node.module) else None
            else:
                wire, *operands = self._paths[node.memory_name]
                yield interpreter.node_output(str(wire), tuple(map(int, operands)))

    def _windows(self, interpreter: Interpreter) -> Iterator[tuple[int, float]]:
        """Yield the nodes whose time constant runs down, with the remaining seconds."""
        for i, node in enumerate(self._network.nodes):
            if not isinstance(node, ModuleLeaf) and node.window_ns:
                wire, *operands = self._paths[node.memory_name]
                left = interpreter.remaining_ns(str(wire), tuple(map(int, operands)), node.window_ns)
                if left:
                    yield i, left / 1e9

    def _module(
        self,
        name: str,
        verdicts: Mapping[str, Verdict],
        outcome: Outcome | None,
        interpreter: Interpreter | None,
    ) -> ModuleState:
        """Return a module's recorded fate; where it was not recorded, what the interpreter says.

        The client of a module in Python is recorded as silent also where the answer was "not applicable".
        """
        actuator = self._actuators[name]
        verdict = None if actuator is None else verdicts.get(actuator)
        fate = None if verdict is None else dict(verdict.fates).get(name)
        if fate == "silent" and interpreter is not None and not interpreter.is_silent(name):
            return "inactive"
        if fate is not None:
            return fate
        if interpreter is None or outcome is None:
            return "won" if verdict is not None and verdict.by == name else "unknown"
        if interpreter.is_silent(name):
            return "silent"
        if verdict is not None and verdict.by == name:
            return "won"
        return "active" if interpreter.is_active(name) else "inactive"

    def _pose_in(self, frame: Frame) -> tuple[float, float, float] | None:
        values = [frame.readings.get(s.name) for s in self._pose]
        numbers = [
            x * s.factor
            for x, s in zip(values, self._pose, strict=True)
            if isinstance(x, int | float) and math.isfinite(x)
        ]
        return (numbers[0], numbers[1], numbers[2]) if len(numbers) == 3 else None


def _live(
    network: Network, outputs: Sequence[str | None], verdicts: Mapping[str, Verdict]
) -> Iterator[tuple[int, int | str]]:
    """Yield the wires along which the winner's command reaches its actuator."""
    for actuator, root in network.outputs:
        verdict = verdicts.get(actuator)
        if outputs[root] is None or (verdict is not None and verdict.by != outputs[root]):
            continue
        yield root, actuator
        index = root
        while not isinstance(node := network.nodes[index], ModuleLeaf):
            dominates = isinstance(node, Suppressor) and outputs[node.dominant] is not None
            source = node.dominant if dominates else node.inferior
            yield source, index
            index = source


def _command(
    actuator: Actuator,
    verdict: Verdict | None,
    interpreter: Interpreter | None,
    heard: HeardCommand | None,
) -> CommandSnapshot:
    bounds = None if interpreter is None else interpreter.bounds(actuator)
    low: tuple[float | None, ...] = (None,) * len(actuator.fields)
    high = low
    if bounds is not None:
        low, high = (
            tuple(map(_bound, in_declared_units(tuple(b[i] for b in bounds), actuator.fields) or ()))
            for i in (0, 1)
        )
    return CommandSnapshot(
        by=None if verdict is None else verdict.by,
        sent=None if verdict is None else verdict.values,
        low=low,
        high=high,
        fault=None if verdict is None else verdict.fault,
        outside=None if verdict is None else verdict.outside,
        hold=None if verdict is None else verdict.hold,
        is_decided=verdict is not None,
        heard=None if heard is None else heard.values,
    )


def _bound(value: ScalarValue) -> float | None:
    return value if not isinstance(value, bool) and math.isfinite(value) else None


def _contract(name: str, outcome: Outcome | None, interpreter: Interpreter | None) -> ContractState:
    if outcome is None or interpreter is None or interpreter.is_unknown(name):
        return "unknown"
    return "broken" if name in outcome.breaches else "held"


def _late(tick: Tick, verdicts: Mapping[str, Verdict]) -> Iterator[str]:
    for actuator, verdict in verdicts.items():
        for client, fate in verdict.fates:
            if fate in ("late", "lost", "refused") and not is_connection(client):
                yield f"{actuator}/{client} {fate}"
    yield from (f"{server} down" for server in tick.down)


def _cell(sensor: SensorScene, reading: Reading) -> Cell:
    """Return a reading in the unit of its scene; what is not a number becomes None."""
    if isinstance(reading, Sequence) and not isinstance(reading, str):
        return tuple([_scaled(x, sensor.factor) for x in reading])
    return _scaled(reading, sensor.factor)


def _scaled(x: object, factor: float) -> float | bool | None:
    if isinstance(x, bool):
        return x
    if not isinstance(x, int | float) or not math.isfinite(x):
        return None
    return round(x * factor, DECIMALS)


def _number(x: ScalarValue) -> float | bool | None:
    return x if isinstance(x, bool) or math.isfinite(x) else None


# --- marks ---------------------------------------------------------------------------------------------
#
# Moments of a run that a page can jump to, and that its timeline shows.


class FrameMark(IntFlag):
    """What begins with a frame."""

    NOTHING = 0
    WINNER = 1
    """Another module, or none, commands an actuator."""
    BREACH = 2
    """A contract breaks."""
    FAULT = 4
    """A winner's command cannot be sent, or a sensor has a faulty value."""
    LATE = 8
    """A client is late, lost or refused, or a server is down."""
    OUTSIDE = 16
    """A connection outside the network commands, a lock holds, or an emergency stop begins."""
    RESTART = 32
    """All memory restarts."""


def mark_of(before: PageFrame | None, now: PageFrame) -> FrameMark:
    """Return what begins with a frame; `before` is the frame before it, None for the first.

    Only a broken contract can begin with the first frame: nothing else of a run begins there.
    """
    if before is None:
        return FrameMark.BREACH if "broken" in now.contracts else FrameMark.NOTHING
    pairs = tuple(zip(before.commands, now.commands, strict=True))
    mark = FrameMark.NOTHING
    if any(a.by != b.by for a, b in pairs):
        mark |= FrameMark.WINNER
    contracts = zip(before.contracts, now.contracts, strict=True)
    if any(b == "broken" and a != "broken" for a, b in contracts):
        mark |= FrameMark.BREACH
    if any(b.fault is not None and a.fault != b.fault for a, b in pairs) or set(now.stale) - set(
        before.stale
    ):
        mark |= FrameMark.FAULT
    if set(now.late) - set(before.late):
        mark |= FrameMark.LATE
    begins = any((a.outside, a.hold) != (b.outside, b.hold) and (b.outside or b.hold) for a, b in pairs)
    if begins or (now.stopped_by is not None and before.stopped_by is None):
        mark |= FrameMark.OUTSIDE
    if now.is_restart:
        mark |= FrameMark.RESTART
    return mark
