"""A run that a proof found, as the recording that a robot would have made of it.

Clients bid as they do on a robot, and the reference interpreter decides. Commands from outside, and late or
lost clients, become fates and sources in the verdicts of servers.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import partial
from typing import cast

from colony.compile.pipeline import compile_program
from colony.execute.executor import ClientsExecutor, ClientStep
from colony.execute.intake import converted
from colony.ir.frame import Answer, Decision, Frame, OverriddenCommand, Reading
from colony.ir.program import Program, PythonModule
from colony.runtime.frames.run_frame import FilePosition, RunFrame
from colony.runtime.protocol.messages import Fate, Tick, Verdict
from colony.verify.reference.interpreter import Interpreter
from colony.verify.snapshot import Snapshot
from colony.verify.testing.agreement import frame_in_base_units

OPERATOR = "operator/1"
"""The connection that gives the commands from outside."""


class PlayedRun:
    """A run of a program from its initial memory; it has the face of an open recording.

    A reading is the number in its declared unit that is converted to that of the snapshot; the nearest one if
    there is none. Modules in Python are not run: they answer as the snapshots say.

    Args:
        program: the program.
        snapshots: the inputs of each frame.
    """

    run = None
    truncation = None
    remarks = ()
    shadow = damaged = False

    def __init__(self, program: Program, snapshots: Iterable[Snapshot]) -> None:
        self.program = program
        self.recorded = tuple(_recorded(program, snapshots))

    def go_to(self, place: FilePosition) -> None:
        """Do nothing: no frame has a place."""

    def frames(self, program: Program) -> Iterator[RunFrame]:
        """Yield the frames."""
        return iter(self.recorded)


def _recorded(program: Program, snapshots: Iterable[Snapshot]) -> Iterator[RunFrame]:
    compiled = compile_program(program).compiled
    clients = ClientsExecutor(compiled, [(actuator, module) for actuator, module, _ in compiled.clients])
    python = [m.name for m in program.modules if isinstance(m, PythonModule)]
    servers = {a.name: a.server for a in program.robot.actuators}
    addresses = {module: f"{servers[actuator]}/{module}" for actuator, module in clients.clients}
    interpreter, start = Interpreter(program, answers_given=True), 0
    for k, snapshot in enumerate(snapshots):
        if snapshot.restarted and k > 0:
            interpreter, start = Interpreter(program, answers_given=True), k
            clients.restart()
        readings = {**interpreter.last, **_in_declared_units(program, snapshot)}
        frame = Frame(snapshot.t_ns, readings, restarted=snapshot.restarted)
        answers = {name: _answer(snapshot, name) for name in python}
        outcome = interpreter.step(frame, snapshot.lost, answers, snapshot.given)
        steps = clients.step(frame_in_base_units(program, frame), answers, snapshot.lost)
        by_client = dict(zip(clients.clients, steps, strict=True))
        verdicts = {}
        for actuator, decision in zip(program.robot.actuators, outcome.decisions, strict=True):
            own = {module: step for (name, module), step in by_client.items() if name == actuator.name}
            given = snapshot.given.get(actuator.name)
            winner = interpreter.network_decision(actuator).by
            fates = _fates(own, winner, given, snapshot.lost)
            verdicts[actuator.name] = _verdict(k, snapshot.t_ns, decision, given, fates)
        lost = tuple(addresses[module] for module in sorted(snapshot.lost & addresses.keys()))
        yield RunFrame(
            tick=Tick(k=k, t_ns=snapshot.t_ns, start=start, lost=lost, restarted=snapshot.restarted),
            frame=frame,
            verdicts=verdicts,
            answers=answers,
            restart=start == k > 0,
            breaches=outcome.breaches,
            expected=outcome,
        )


def _fates(
    steps: Mapping[str, ClientStep],
    winner: str | None,
    given: OverriddenCommand | None,
    lost: frozenset[str],
) -> dict[str, Fate]:
    """Return the fates of an actuator's clients; if it idles, the winner is late, or the first client."""
    fates: dict[str, Fate] = {
        module: "lost" if module in lost else "won" if step.bid == "command" else step.bid
        for module, step in steps.items()
    }
    disturbed = winner or next(iter(fates), None)
    if given is not None and disturbed is not None and (given.values is None or winner is not None):
        fates[disturbed] = "late" if given.values is None else "overridden"
    return fates


def _verdict(
    k: int, t_ns: int, decision: Decision, given: OverriddenCommand | None, fates: Mapping[str, Fate]
) -> Verdict:
    return Verdict(
        k=k,
        t_ns=t_ns,
        actuator=decision.actuator,
        by=decision.by,
        values=decision.values,
        fates=tuple(fates.items()),
        fault=decision.fault,
        outside=None if given is None or given.values is None else OPERATOR,
    )


def _answer(snapshot: Snapshot, module: str) -> Answer:
    values = snapshot.answers.get(module)
    return Answer(values=values, blind=values is None and module in snapshot.answers)


def _in_declared_units(program: Program, snapshot: Snapshot) -> dict[str, Reading]:
    factors = {s.name: s.factor for s in program.robot.sensors}
    return {
        name: cast(Reading, converted(value, partial(_declared, factors[name])))
        for name, value in snapshot.readings.items()
        if name in factors
    }


def _declared(factor: float, x: float) -> float:
    """Return the number that is `x` when it is multiplied by a factor; the nearest one if there is none."""
    near = x / factor
    candidates: Sequence[float] = (near, math.nextafter(near, -math.inf), math.nextafter(near, math.inf))
    return next((c for c in candidates if c * factor == x), near)
