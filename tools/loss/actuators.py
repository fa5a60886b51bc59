"""The policy for losses where every actuator is commanded from outside too, at whatever server it is.

Three actuators at three servers, with connections that command, lock and stop at all of them, are held to
the very checks of `outside.py`: verdicts are the interpreter's, or idle with a reason, or within the
bounds of the frame; the monitor and the audit agree; and all comes right again after the faults. What the
lift was made to do is held against its verdicts besides, and so is what its frames say was sent last:

- between two verdicts it was told what the second one says, or the idle command, and nothing else;
- `last.lift` is what this process told it last;
- in frames that are published as stopped nobody commands;
- on `idle hold`, a command from outside is followed by other commands or by `safe`, and never just ends.
"""

from __future__ import annotations

from collections import Counter
from random import Random
from typing import Any, NamedTuple

from colony.ir.program import Actuator
from colony.runtime.protocol.messages import Verdict
from tools.loss.actuators_stage import Robot, variant
from tools.loss.oracle import link
from tools.loss.outside import FAULTY_NS, QUIET_NS, check, is_quiet, plan_faults
from tools.loss.outside_stage import Happened
from tools.loss.seeds import named

VARIANTS = 24


def run(seed: int) -> Counter[str]:
    """One seed; gives what happened in it.

    Raises:
        AssertionError: the policy does not hold; the message begins with the seed.
    """
    random = Random(f"actuators {seed}")
    frame_ms = random.choice((50, 100, 100, 250))
    made: list[Any] = []
    faults, isolate = link(seed, random, lambda: is_quiet(made)), random.random() < 0.5
    program = variant(seed % VARIANTS, frame_ms)
    robot = Robot(program, seed=seed, random=random, until_ns=FAULTY_NS, link=faults, isolate=isolate)
    made.append(robot)
    plan_faults(robot, random)
    with named(f"seed {seed}"):
        robot.session.run(FAULTY_NS + QUIET_NS)
        counts = check(robot)
        check_lift(robot, counts)
        check_stops(robot)
        for verdict in robot.seen.verdicts.values():
            outside = verdict.outside is not None and verdict.fault is None
            counts[f"commands from outside at {verdict.actuator}"] += outside
        return counts


class Lift(NamedTuple):
    """What a process of the lift's server did last.

    `told` is what the lift was told since the last verdict, `last` what it was told last, None for nothing.
    `outside` is True from a command of a connection until other commands, or `safe`, and `safe` from then
    until the next command. `k` is the newest frame.
    """

    told: tuple[tuple[float, bool], ...] = ()
    last: tuple[float, bool] | None = None
    outside: bool = False
    safe: bool = True
    k: int = -1


def check_stops(robot: Robot) -> None:
    """In a frame that a server published as stopped, nobody commands its actuators."""
    stopped: dict[str, int] = {}
    for one in robot.happened:
        if one.kind == "frame" and one.what.stopped is not None:
            stopped[one.server] = one.what.k
        if one.kind == "verdict" and stopped.get(one.server) == one.what.k:
            assert one.what.hold == "stopped", f"although {one.server} is stopped: {one.what}"


def check_lift(robot: Robot, counts: Counter[str]) -> None:
    """Hold what the lift was made to do against verdicts and frames."""
    (lift,) = (a for a in robot.program.robot.actuators if a.name == "lift")
    process = Lift()
    for one in robot.happened:
        if one.server != "Lift":
            continue
        counts["commands to the lift"] += one.kind == "told"
        counts["times that the lift was made safe"] += one.kind == "stopped"
        process = after(lift, process, one)


def after(lift: Actuator, process: Lift, one: Happened) -> Lift:
    """The process after something happened to it."""
    match one.kind:
        case "killed":
            return Lift()
        case "told":
            return process._replace(told=(*process.told, one.what), last=one.what, outside=False, safe=False)
        case "stopped":
            return process._replace(outside=False, safe=True)
        case "verdict":
            check_told(lift, process, one.what)
            if one.what.actuator != lift.name and one.what.values:  # not of the program, which forgets it
                process = process._replace(last=None)
            outside = one.what.outside is not None and bool(process.told) and not process.safe
            return process._replace(told=(), outside=outside)
        case "frame" if one.what.fields:
            if one.what.k < process.k:
                return process  # the tick came after a later one
            check_last(process, one)
            return process._replace(k=one.what.k)
        case _:
            return process


def check_told(lift: Actuator, process: Lift, verdict: Verdict) -> None:
    """The lift was told what the verdict says, or to be idle.

    Before the program is deployed to its server, verdicts are of the server's own actuator, in base units.
    """
    factor = lift.fields[0].factor if verdict.actuator == lift.name else 1.0
    sent = None if verdict.values is None else (float(verdict.values[0]) * factor, bool(verdict.values[1]))
    idle = None if lift.idle is None else (float(lift.idle[0]), bool(lift.idle[1]))
    for told in process.told:
        assert told == idle or _same(told, sent), f"the lift was told {process.told}: {verdict}"
    halted = verdict.hold == "stopped" or any("too late" in note for note in verdict.notes)
    if sent is not None and not halted and sent != idle:
        assert any(_same(told, sent) for told in process.told), f"the lift was not told {sent}: {verdict}"
    if verdict.values is None and verdict.hold is None and verdict.outside is None and lift.idle is None:
        assert not process.outside, f"a command from outside just ended: {verdict}"


def _same(told: tuple[float, bool], sent: tuple[float, bool] | None) -> bool:
    return sent is not None and abs(told[0] - sent[0]) < 1e-9 and told[1] is sent[1]


def check_last(process: Lift, one: Happened) -> None:
    """`last` is what this process told the lift last, in frames that are on time."""
    sample = one.what.fields.get("last.lift.height")
    found = None if sample is None else sample.value
    told = None if process.last is None else process.last[0]
    assert found == told, f"frame {one.what.k}: last.lift.height is {found}, told was {told}"
