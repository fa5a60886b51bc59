"""The policy for losses, over random programs and random faults: whatever dies, freezes, comes back or gets
lost on its way, no command is sent that the reference interpreter would not have sent in that frame.

Each seed is a program, a trace, and a plan of faults, in virtual time; clients share a process in every other
one. What the frames were is taken from the network afterwards (`oracle.py`): what servers published, and what
the Clock said of them. Then

- every command that left arbitration is the interpreter's for that frame, or the idle one;
- every checkpoint, and the memory of every client at the end, is that of one which saw all frames of the
  epoch, in order, each once;
- in an epoch frames follow each other, and the interpreter begins anew with it and only there;
- no frame has two commands, no server publishes two different frames of one number;
- the monitor finds nothing wrong either;
- and when the faults are over, everyone is on time again.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from functools import lru_cache
from random import Random
from typing import Literal, NamedTuple

from colony.execute.executor import ClientMemory
from colony.ir.frame import Answer, Decision, Frame
from colony.ir.program import Program
from colony.runtime.assembly.scripted import SentCommand
from colony.runtime.clients.client import decode_memory
from colony.runtime.protocol import topics
from colony.runtime.protocol.messages import Tick
from colony.runtime.protocol.topics import module_of
from colony.verify.reference.interpreter import Interpreter
from colony.verify.testing.agreement import frame_in_base_units
from tests.drawn.strategies import run_of_seed
from tests.programs import OneClient
from tools.loss.oracle import MS, check_recovered, epochs, link, observed, plan, possible_frames
from tools.loss.seeds import named
from tools.loss.stage import Robot

FAULTY, QUIET = 22, 20
"""Frames with faults, and frames after them in which all must come right again."""

PLANS = 5
"""Plans of faults that each program is run with."""


class Drawn(NamedTuple):
    """A program to be run, with frames."""

    program: Program
    trace: tuple[Frame, ...]


@lru_cache(maxsize=4)
def drawn(number: int, degrade: bool) -> Drawn:
    """Program `number`; every other one is all network."""
    program, trace = run_of_seed(number, network=degrade or number % 2 == 0, max_frames=16)
    on_loss: Literal["degrade", "stop"] = "degrade" if degrade else "stop"
    actuators = tuple(replace(a, on_loss=on_loss) for a in program.robot.actuators)
    program = replace(program, robot=replace(program.robot, actuators=actuators))
    return Drawn(program, trace)


def run(seed: int, *, degrade: bool = False, often: str | None = None) -> Counter[str]:
    """One seed; gives what happened in it. The process `often` fails more often than others.

    Raises:
        AssertionError: the policy does not hold; the message begins with the seed.
    """
    random = Random(seed)
    what = drawn(seed // PLANS, degrade)
    frame_ns = random.choice((250, 250, 250, 250, 250, 100)) * MS
    until_ns = FAULTY * frame_ns
    made: list[Robot] = []
    faults = link(seed, random, lambda: not made or made[0].now_ns >= until_ns)
    isolate = seed % 2 == 1
    robot = Robot(what.program, what.trace, frame_ns=frame_ns, seed=seed, link=faults, isolate=isolate)
    made.append(robot)
    plan(robot, random, until_ns, often=often)
    with named(f"seed {seed}{', degrade' if degrade else ''}"):
        robot.run(FAULTY + max(QUIET, 4_500 * MS // frame_ns))
        return check(robot)


# --- what should have been -------------------------------------------------------------------------


ANYTHING = (0.0,) * 8
"""The fields of a command that nobody looks at: memory depends on who is active alone."""


class Path(NamedTuple):
    """The frames of an epoch, what the interpreter decides in them, and what modules in Python answer."""

    frames: dict[int, Frame]
    decisions: dict[int, dict[str, Decision]]
    answers: dict[int, dict[str, Answer]]


def path_of(robot: Robot, epoch: list[Tick], frames: dict[int, Frame]) -> Path:
    """What the reference does in an epoch with these frames."""
    interpreter, path = Interpreter(robot.program), Path(frames, {}, {})
    degrading = any(a.on_loss == "degrade" for a in robot.program.robot.actuators)
    for tick in epoch:
        lost = frozenset(map(module_of, tick.lost)) if degrading else frozenset[str]()
        outcome = interpreter.step(frames[tick.k], lost)
        path.decisions[tick.k] = {d.actuator: d for d in outcome.decisions}
        path.answers[tick.k] = {
            m: Answer(ANYTHING if interpreter.is_active(m) else None) for m in robot.compiled.python_modules
        }
    return path


# --- the checks ------------------------------------------------------------------------------------


def check(robot: Robot) -> Counter[str]:
    """Hold a run against the reference; gives what happened in it."""
    seen, counts = robot.seen, Counter[str]()
    sent: dict[int, list[SentCommand]] = {}
    for one in seen.sent:
        sent.setdefault(one.k, []).append(one)
    last: Path | None = None
    for epoch in epochs(seen.ticks):
        paths = [path_of(robot, epoch, frames) for frames in possible_frames(robot, epoch)]
        counts["epochs with disputed frames"] += len(paths) - 1
        for tick in epoch:
            for one in sent.get(tick.k, ()):
                check_sent(robot, one, [p.decisions[tick.k][one.actuator] for p in paths])
                counts["commands" if one.by else "idle"] += 1
        check_memory(robot, epoch, paths, counts)
        counts["frames"] += len(epoch)
        counts["epochs"] += 1
        counts["gaps"] += sum(t.previous != t.k - 1 for t in epoch)
        last = paths[0]
    list(observed(robot))
    counts["epochs asked for"] += len({start for _, start in seen.restarts})
    counts["clients that recalled memory"] += len(seen.recalled)
    assert last is not None, "the run never began"
    newest = max(last.frames)
    for k in range(newest - 3, newest):
        check_recovered(robot, k, last.decisions[k])
    return counts


def check_sent(robot: Robot, one: SentCommand, due: list[Decision]) -> None:
    """A command is one of those that are due, or idle."""
    if one.by is None:
        idle = next(a.idle for a in robot.program.robot.actuators if a.name == one.actuator)
        factors = [
            f.factor for a in robot.program.robot.actuators if a.name == one.actuator for f in a.fields
        ]
        values = idle and tuple(
            x if isinstance(x, bool) else x / f for x, f in zip(idle, factors, strict=True)
        )
        assert repr(one.values) == repr(values), f"{one} is not idle"
        return
    wanted = [repr((d.by, d.values, d.fault)) for d in due]
    assert repr((one.by, one.values, one.fault)) in wanted, f"{one} was sent, due was {' or '.join(wanted)}"


def check_memory(robot: Robot, epoch: list[Tick], paths: list[Path], counts: Counter[str]) -> None:
    """Checkpoints, and memory at the end, are those of a client that saw every frame of the epoch once.

    Where clients share a process, the first that needs a cell has it in its checkpoint.
    """
    seen, degrading = robot.seen, any(a.on_loss == "degrade" for a in robot.program.robot.actuators)
    for actuator, module, _ in robot.compiled.clients:
        address = topics.client_address(actuator, module)
        node = robot.client(address)
        at_end = node.frontier if node.frontier[0] == epoch[0].start else (-1, -1)
        saved = {t.k: seen.checkpoints[address, t.k] for t in epoch if (address, t.k) in seen.checkpoints}
        if not saved and at_end[1] < epoch[0].k:
            continue
        ends = max([*saved, at_end[1]])
        allowed: dict[int, list[ClientMemory]] = {}
        for path in paths:
            executor = OneClient(robot.compiled, actuator, module)
            for tick in epoch:
                if tick.k > ends:
                    break
                lost = frozenset(map(module_of, tick.lost)) if degrading else frozenset[str]()
                executor.step(
                    frame_in_base_units(robot.program, path.frames[tick.k]), path.answers[tick.k], lost
                )
                if tick.k in saved or tick.k == at_end[1]:
                    allowed.setdefault(tick.k, []).append(executor.memory)
        for k, data in saved.items():
            counts["checkpoints"] += 1
            found = decode_memory(data)
            assert any(is_part(found, due) for due in allowed[k]), (
                f"{address}: checkpoint {k} is {found}, due was {allowed[k]}"
            )
        if at_end[1] in allowed:
            found = decode_memory(node.program.memory(address))
            assert any(is_part(found, due) for due in allowed[at_end[1]]), (
                f"{address}: remembers {found}, due was {allowed[at_end[1]]}"
            )


def is_part(found: ClientMemory, due: ClientMemory) -> bool:
    cells = {name: due.cells[name] for name in found.cells if name in due.cells}
    return repr((found.first_ns, dict(found.cells))) == repr((due.first_ns, cells))
