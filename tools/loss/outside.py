"""The policy for losses where others drive too: whatever dies, freezes, comes back or gets lost on its way,
each command that left is the interpreter's, the idle one, or one from outside within the limits of its frame.

Each seed is a variant of one program with three actuators, the real servers in virtual time, three
connections that drive, lock, stop and set variables, sensors that fail, and a plan of faults as in
`policy.py`. What the frames were is taken from the network afterwards (`oracle.py`). Then

- every verdict is the interpreter's, or idle with a reason; a command from outside is within the
  interpreter's bounds for that frame;
- what the base was told is what a verdict says, or what was due in a frame whose verdict was lost;
- `last.ACTUATOR.FIELD` in a frame is what that process of the server sent last, and what it set the variable
  to; on `idle hold` an earlier process, too; what modules did is what the verdict of the frame before says;
- contracts that are proved with operators are never broken, neither in the interpreter nor by the monitor,
  and the audit of what was observed agrees;
- and when the faults are over, everyone is on time again, and nobody drives but the program.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from functools import lru_cache
from random import Random
from types import MappingProxyType
from typing import Any, NamedTuple

from colony.analysis.audit import audit
from colony.analysis.report import objection, outside_objection, same_values
from colony.ir.frame import MISSED, Decision, Frame, Outcome, given_in_frame
from colony.ir.program import Program, Role, in_declared_units
from colony.runtime.protocol.messages import ACTIVE, Tick, Verdict
from colony.verify.contracts.prove import prove_contracts
from colony.verify.contracts.results import ProofOptions, Proved
from colony.verify.reference.interpreter import Interpreter
from tools.loss.oracle import MS, check_recovered, epochs, link, observed, plan, possible_frames
from tools.loss.outside_stage import SERVERS, Happened, Robot, variant
from tools.loss.seeds import named

FAULTY_NS = 5_000 * MS
QUIET_NS = 5_000 * MS
"""Time with faults, and time after them in which all must come right again."""

VARIANTS = 12


def plan_faults(robot: Robot, random: Random) -> None:
    """Kill, freeze and revive processes; when the time of the faults ends, all live."""
    session = robot.session
    often = random.choice((None, None, "Clock", "RServer", "DServer", session.processes[-1]))
    counts = (0, 1, 1, 2, 3, 5, 8)
    plan(session, random, FAULTY_NS, often=often, counts=counts, kill=robot.kill)


def is_quiet(made: list[Robot]) -> bool:
    """Return True before the robot is made, and after the faults."""
    return not made or made[0].now_ns >= FAULTY_NS


def run(seed: int) -> Counter[str]:
    """One seed; gives what happened in it.

    Raises:
        AssertionError: the policy does not hold; the message begins with the seed.
    """
    random = Random(seed)
    frame_ms = random.choice((50, 100, 100, 250))
    program = variant(seed % VARIANTS, frame_ms)
    made: list[Robot] = []
    faults, isolate = link(seed, random, lambda: is_quiet(made)), random.random() < 0.5
    robot = Robot(program, seed=seed, random=random, until_ns=FAULTY_NS, link=faults, isolate=isolate)
    made.append(robot)
    plan_faults(robot, random)
    with named(f"seed {seed}"):
        robot.session.run(FAULTY_NS + QUIET_NS)
        return check(robot)


@lru_cache(maxsize=64)
def proved(program: Program) -> frozenset[str]:
    """The contracts that are proved with operators."""
    results = prove_contracts(program, ProofOptions())
    return frozenset(r.contract.name for r in results if isinstance(r, Proved) and r.operators)


# --- what should have been -------------------------------------------------------------------------


class Due(NamedTuple):
    """What the interpreter makes of a frame, one of those that it may have been."""

    interpreter: Interpreter
    outcome: Outcome
    decisions: dict[str, Decision]


def step(robot: Robot, interpreter: Interpreter, frame: Frame, verdicts: dict[str, Verdict]) -> Due:
    """The interpreter's outcome, given what was sent, and what the network decided whatever was."""
    actuators = robot.program.robot.actuators
    outcome = interpreter.step(frame, given=given_in_frame(actuators, verdicts))
    return Due(interpreter, outcome, {a.name: interpreter.network_decision(a) for a in actuators})


# --- the checks ------------------------------------------------------------------------------------


def check(robot: Robot) -> Counter[str]:
    """Hold a run against the reference; gives what happened in it."""
    counts, orphans = Counter[str](), check_servers(robot)
    newest: tuple[Tick, Due] | None = None
    seen = robot.seen
    for epoch in epochs(seen.ticks):
        possible = [(Interpreter(robot.program), frames) for frames in possible_frames(robot, epoch)]
        for tick in epoch:
            verdicts = {
                a.name: seen.verdicts[tick.k, a.name]
                for a in robot.program.robot.actuators
                if (tick.k, a.name) in seen.verdicts
            }
            dues = [step(robot, one, frames[tick.k], verdicts) for one, frames in possible]
            check_frame(robot, tick, dues, verdicts, counts)
            for told in orphans.pop(tick.k, ()):
                check_orphan(robot, tick, dues, told)
                counts["commands whose verdict was lost"] += 1
            newest = tick, dues[0]
            if tick.k + 1 in seen.ticks and tick.t_ns > (FAULTY_NS + QUIET_NS) - 1000 * MS:
                check_recovered(robot, tick.k, dues[0].decisions)
        counts["frames"] += len(epoch)
        counts["epochs"] += 1
        counts["epochs with disputed frames"] += len(possible) - 1
        counts["gaps"] += sum(t.previous != t.k - 1 for t in epoch)
    assert newest is not None, "the run never began"
    assert newest[0].t_ns > FAULTY_NS + QUIET_NS - 600 * MS, f"the last frame is at {newest[0].t_ns}"
    check_observed(robot, counts)
    return counts


def check_frame(
    robot: Robot, tick: Tick, dues: list[Due], verdicts: dict[str, Verdict], counts: Counter[str]
) -> None:
    """Every verdict is due, and no contract is broken that is proved."""
    for actuator in robot.program.robot.actuators:
        verdict = verdicts.get(actuator.name)
        if verdict is None:
            counts["verdicts lost"] += 1
            continue
        wrong = [_objection(actuator, verdict, due) for due in dues]
        assert None in wrong, f"frame {tick.k}: {verdict} was sent: {wrong}; due was {dues[0].decisions}"
        counts["verdicts"] += 1
        counts["commands"] += verdict.by is not None
        counts["commands from outside"] += verdict.outside is not None and verdict.fault is None
        counts["commands from outside without bounds"] += verdict.fault == "limits unknown"
        counts["commands from outside without limits"] += verdict.unlimited
        counts[f"held: {verdict.hold}"] += verdict.hold is not None
        counts["idle since a client was not heard"] += any(f in MISSED for _, f in verdict.fates)
    if not any(v.unlimited for v in verdicts.values()):
        broken = [proved(robot.program).intersection(due.outcome.breaches) for due in dues]
        assert not all(broken), f"frame {tick.k}: {broken} broken, although proved; sent was {verdicts}"


def _objection(actuator: Any, verdict: Verdict, due: Due) -> str | None:
    decision = due.decisions[actuator.name]
    if verdict.outside is None and verdict.hold is None:
        return objection(actuator, verdict, decision, due.interpreter)
    if verdict.outside is None:
        idle = same_values(verdict.values, in_declared_units(actuator.idle, actuator.fields))
        return None if idle and verdict.by is None else "not idle, although it was held"
    if verdict.hold is None and decision.by is not None and verdict.outside.startswith("scripts/below"):
        return f"{verdict.outside} acted, which is below `{decision.by}`"
    return outside_objection(actuator, verdict, due.interpreter)


def check_orphan(robot: Robot, tick: Tick, dues: list[Due], told: tuple[float, float]) -> None:
    """What the base was told, without a verdict, was due, idle, or within the bounds of somebody outside."""
    (drive,) = (a for a in robot.program.robot.actuators if a.name == "drive")
    if robot.ignoring or told == (0.0, 0.0):
        return
    for due in dues:
        bounds = due.interpreter.bounds(drive)
        velocity, turn = told
        if told == due.decisions["drive"].values or (
            bounds is not None
            and (bounds[0][0] <= velocity <= bounds[0][1] or velocity == 0.0)  # 0: a bumper was pressed
            and bounds[1][0] <= turn <= bounds[1][1]
        ):
            return
    raise AssertionError(f"frame {tick.k}: the base was told {told}, due was {dues[0].decisions['drive']}")


def check_observed(robot: Robot, counts: Counter[str]) -> None:
    """The monitor found nothing that is proved to be broken, and the audit agrees."""
    for log in observed(robot):
        if not any(v.unlimited for v in log.verdicts.values()):
            broken = proved(robot.program).intersection(log.expected.breaches)
            assert not broken, f"frame {log.tick.k}: the monitor finds {broken} broken, although proved"
        counts["contracts broken that are not proved"] += len(log.expected.breaches)
    report = audit(robot.program, robot.log.frames)
    assert report.agrees, f"the audit finds {report.first}"


# --- what servers did ------------------------------------------------------------------------------


class Process(NamedTuple):
    """What a process of a server did last.

    `given` is what its actuators have, or may have (`unsure`): where a verdict names a command that the base
    was not told, it came too late, and the base was halted. `halted` is whether it was, since it was `told`
    something. `inherited` are the actuators on hold to which it has sent nothing: they have what an earlier
    process sent, which may have died before it said so. `before_halt` is what they had before the last halt,
    and its time: a frame of that time may have been published before it. `verdicts` are the last ones.
    """

    given: dict[str, tuple[Any, ...]]
    told: tuple[float, float] | None = None
    k: int = -1
    t_ns: int = 0
    halted: bool = False
    unsure: bool = False
    inherited: frozenset[str] = frozenset()
    before_halt: tuple[int, dict[str, tuple[Any, ...]]] = (-1, {})
    verdicts: Mapping[str, Verdict] = MappingProxyType({})


def check_servers(robot: Robot) -> dict[int, list[tuple[float, float]]]:
    """Hold what servers said and did against each other; gives what was told without a verdict, by frame."""
    processes, orphans = {s: Process({}) for s in SERVERS}, dict[int, list[tuple[float, float]]]()
    for one in robot.happened:
        before = processes.get(one.server)
        if before is not None:
            if one.kind == "killed" and before.told is not None:
                orphans.setdefault(before.k, []).append(before.told)
            processes[one.server] = after(robot, before, one)
    last = processes["RServer"]
    if last.told is not None:
        orphans.setdefault(last.k, []).append(last.told)
    return orphans


def after(robot: Robot, process: Process, one: Happened) -> Process:
    """The process after something happened to it."""
    if one.kind == "verdict":
        return _after(robot, process, one)._replace(
            verdicts={**process.verdicts, one.what.actuator: one.what}
        )
    return _after(robot, process, one)


def _after(robot: Robot, process: Process, one: Happened) -> Process:
    match one.kind:
        case "killed":
            holding = _holding(robot)
            return Process(
                {name: sent for name, sent in process.given.items() if name in holding},
                inherited=frozenset(holding),
            )
        case "told":
            assert process.told is None, f"frame {process.k}: the base was told {process.told} and {one}"
            return process._replace(told=one.what, halted=False)
        case "stopped":
            actuators = [a for a in robot.program.robot.actuators if a.server == one.server]
            idle: dict[str, Any] = {
                a.name: in_declared_units(a.idle, a.fields) for a in actuators if a.idle is not None
            }
            halt = (one.t_ns, process.given)
            return process._replace(halted=True, given={**process.given, **idle}, before_halt=halt)
        case "verdict" if one.what.actuator == "drive":
            check_told(robot, process, one)
            taken = process.told is None or not process.halted
            sent = one.what.values if process.told is None else process.told  # what a bumper did not hold
            given = {**process.given, "drive": sent} if taken else process.given
            return process._replace(told=None, unsure=process.told is None, given=given)
        case "verdict" if process.halted and one.what.actuator not in _holding(robot):
            t_ns, before = process.before_halt  # what it says was sent before the server halted
            if t_ns == one.t_ns and one.what.values is not None:
                before = {**before, one.what.actuator: one.what.values}
            return process._replace(before_halt=(t_ns, before))
        case "verdict" if one.what.values is not None:
            return process._replace(
                given={**process.given, one.what.actuator: one.what.values},
                inherited=process.inherited - {one.what.actuator},
            )
        case "frame" if one.what.fields:  # else the server missed the tick
            late = one.what.k < process.k
            if not late or any(name.startswith("last.") for name in one.what.fields):
                check_last(robot, process, one)
                check_roles(robot, process, one)
            if late:
                return process
            halted = process.halted and one.server == "RServer"
            return process._replace(k=one.what.k, t_ns=one.t_ns, unsure=False, halted=halted)
        case _:
            return process


def _holding(robot: Robot) -> frozenset[str]:
    """The actuators on `idle hold`."""
    return frozenset(a.name for a in robot.program.robot.actuators if a.idle is None)


def check_told(robot: Robot, process: Process, one: Happened) -> None:
    """The base was told what the verdict says, or halted; or the front bumper held it."""
    verdict: Verdict = one.what
    if verdict.actuator != "drive" or process.told is None:
        return
    assert verdict.values is not None
    velocity, turn = verdict.values
    pressed = any(robot.devices.bumper_at(max(0, one.t_ns - ago * MS)) for ago in range(0, 2000, 50))
    held = velocity > 0.0 and pressed and process.told == (0.0, turn)
    assert held or process.told == (velocity, turn), f"the base was told {process.told}: {verdict}"


def check_roles(robot: Robot, process: Process, one: Happened) -> None:
    """What modules did is what the verdict of the frame before says; it is known of no other frame."""
    for sensor in robot.program.robot.sensors:
        if sensor.sent is None or isinstance(sensor.sent.of, int) or sensor.server != one.server:
            continue
        role, verdict = sensor.sent.of, process.verdicts.get(sensor.sent.actuator)
        sample, where = one.what.fields.get(sensor.name), f"frame {one.what.k}: {sensor.name}"
        if verdict is None or sample is None:
            is_next = verdict is not None and verdict.k == one.what.k - 1 and one.what.k > process.k
            assert sample is None, f"{where} is {sample} in a process without a verdict"
            assert not is_next, f"{where} is not known, after {verdict}"
            continue
        fate = dict(verdict.fates)[role.module]
        expected = fate == "won" if role.kind == "by" else fate in ACTIVE
        refused = role.kind == "by" and bool(verdict.notes or process.unsure) and not sample.value
        assert sample.value is expected or refused, f"{where} is {sample.value}, after {verdict}"


def check_last(robot: Robot, process: Process, one: Happened) -> None:
    """`last` is what this process of the server sent last; or idle, if it halted since.

    On `idle hold` it is what an earlier process sent, until this one sends something.
    """
    fields = one.what.fields
    for actuator in robot.program.robot.actuators:
        if actuator.server != one.server:
            continue
        given, idle = process.given.get(actuator.name), in_declared_units(actuator.idle, actuator.fields)
        late = one.server == "DServer" and one.t_ns - process.t_ns > 2 * robot.program.robot.frame_ns
        for i in robot.program.robot.read_before(actuator.name):
            if isinstance(i, Role):
                continue
            field = actuator.fields[i]
            sample = fields.get(f"last.{actuator.name}.{field.name}")
            allowed = [None if given is None else given[i]]
            if idle is not None and (process.unsure or late):
                allowed.append(idle[i])
            if one.t_ns == process.before_halt[0]:
                before = process.before_halt[1].get(actuator.name)
                allowed.append(None if before is None else before[i])
            found = None if sample is None else sample.value / field.factor
            where = f"frame {one.what.k}: last.{actuator.name}.{field.name}"
            inherited = actuator.name in process.inherited and found is not None
            assert inherited or found in allowed, f"{where} is {found}, was {allowed}"
        variable = fields.get(actuator.command)
        if variable is not None and given is not None and actuator.name not in process.inherited:
            value = variable.value if isinstance(variable.value, tuple | list) else (variable.value,)
            assert tuple(value) == given, (
                f"frame {one.what.k}: {actuator.command} is {value}, sent was {given}"
            )
