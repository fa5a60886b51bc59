"""Drawn programs with drawn faults, run in each layout and compared.

Compared are the messages that an outsider hears, the frames that the observer sees (readings, memory,
decisions, requests, verdicts, broken contracts), the commands to devices, and the audit of the frames.

Messages need no time here, so that several hosts may handle those of one moment in any order. That order is
free: of different senders, of requests in a frame, of commands to different actuators. While messages are
lost or nodes restart, it also decides how often a sender repeats a message for those who fetch it, and if the
recording has a request that came too late to count. What else depends on it, is compared with other orders
(`ATTEMPTS`).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import closing, suppress
from random import Random
from typing import Any, NamedTuple

import msgspec

from colony.analysis.audit import audit
from colony.compile.pipeline import compile_program
from colony.execute.compiled import Compiled
from colony.ir.program import Program
from colony.ir.servers import DSERVER
from colony.runtime.assembly.sharing import announcer_process_name, client_processes
from colony.runtime.frames.run_frame import RunFrame
from colony.runtime.library import clock, data
from colony.runtime.protocol.messages import UNHEARD, Ready, Request, SentMessage, Tick
from colony.runtime.transport.faults import FaultRates
from tests.drawn.strategies import run_of_seed
from tests.drawn.tunables import draw_values, with_tunables
from tests.runtime.transport.live.stage import robot_address, run_directory
from tools.layouts.devices import Command, devices_of, on_devices
from tools.layouts.faults import Failure, Guard
from tools.layouts.stage import BEGIN_NS, Heard, Places, Stage
from tools.layouts.traffic import Traffic

LAYOUTS: dict[str, Places] = {
    "run": Places("hosted", "hosted"),
    "served": Places("composed", "hosted"),
    "mission": Places("composed", "composed"),
    "isolated": Places("isolated", "isolated"),
}
"""The layouts: of `colony run --processes`, of a run on a served robot, with a goal, and with `--isolate`."""

MS = 1_000_000
LEASE_NS = 250 * MS
"""Time after which a server or client counts as lost, as `frames/registry.py` has it."""

TUNINGS = 30
"""Changes of tunable params in a run."""

RATES = FaultRates(lost=0.01, duplicated=0.01, late=0.01, reordered=0.03)


class Plan(NamedTuple):
    """The course of a run.

    `length_ns` is its length. `events` are times, and what happens at them: a stop, its release, a leader
    that leaves and returns. `rates` are those of late and lost messages.
    """

    length_ns: int
    failures: tuple[Failure, ...]
    events: tuple[tuple[int, str], ...]
    rates: FaultRates | None


def draw_plan(random: Random, frame_ns: int, parts: tuple[str, ...]) -> Plan:
    """Draw what happens in a run of a program whose process parts have these names.

    One run in eight is so long that a client which starts again needs its checkpoint. Nothing happens at the
    time of a tick or of a deadline.
    """
    is_long = random.random() < 1 / 8
    length_ns = 3600 * MS if is_long else 1200 * MS
    begin_ns = BEGIN_NS + (2800 if is_long else 400) * MS

    def moment(first_ns: int) -> int:
        """Return a time shortly before a tick."""
        frame = random.randrange(first_ns // frame_ns, (BEGIN_NS + length_ns) // frame_ns)
        return frame * frame_ns - frame_ns // 20 - random.randrange(1000)

    failures = tuple(
        Failure(moment(begin_ns), random.choice(parts), _pause(random, frame_ns))
        for _ in range(random.choice((0, 1, 1, 2, 3)))
    )
    events = list[tuple[int, str]]()
    for first, then, probability in (("stop", "release", 0.3), ("leave", "lead", 0.15)):
        if random.random() < probability:
            t_ns = moment(begin_ns)
            events += [(t_ns, first), (t_ns + random.randrange(1, 10) * frame_ns, then)]
    return Plan(length_ns, failures, tuple(events), RATES if random.random() < 0.4 else None)


def _pause(random: Random, frame_ns: int) -> int:
    """Return the time until a part starts again: none to speak of, some frames, or longer than a lease."""
    frames = random.choice((0, 1, 3, LEASE_NS // frame_ns + 2))
    return frames * frame_ns + frame_ns // 50 + random.randrange(1000)


class Run(NamedTuple):
    """What came of a run: all that is compared, and what it shows that is wrong in any layout."""

    compared: dict[str, list[str]]
    wrong: tuple[str, ...]


def run_in(
    layout: str, program: Program, compiled: Compiled, readings: Any, seed: int, attempt: int = 0
) -> Run:
    """Run a program in a layout, with the faults of a seed; from the second attempt on, hold up messages."""
    plan = draw_plan(Random(f"faults {seed}"), compiled.frame_ns, parts_of(program, compiled))
    if any(s.tunable for s in program.robot.sensors):
        plan = plan._replace(events=(*plan.events, *_tunings(Random(f"tunings {seed}"), plan.length_ns)))
    guard = Guard(seed, plan.rates, plan.failures)
    held_up = Random(f"{seed}/{attempt}").random
    traffic = Traffic(lambda: max(0.0, held_up() - 0.7) / 200 if attempt else 0.0)
    with run_directory() as environment:
        address = robot_address(environment)
        with closing(
            Stage(program, compiled, address, readings, places=LAYOUTS[layout], guard=guard, traffic=traffic)
        ) as stage:
            _play(stage, program, plan, Random(f"values {seed}"))
            heard, commands = tuple(stage.heard), tuple(stage.plant.commands)
    in_order = plan.rates is None and not plan.failures
    return _result(program, heard, commands, stage.logs, in_order=in_order)


def parts_of(program: Program, compiled: Compiled) -> tuple[str, ...]:
    """Return the names of the parts that may fail."""
    devices = devices_of(program)
    return (
        "Clock",
        *(("RServer",) if devices.base is not None else ()),
        *(server.name for server in devices.servers),
        DSERVER.name,
        *(process.name for process in client_processes(compiled, isolate=False)),
        *map(announcer_process_name, compiled.python_modules),
    )


def _tunings(random: Random, length_ns: int) -> Iterator[tuple[int, str]]:
    """Yield the times at which tunable params change."""
    for _ in range(TUNINGS):
        yield BEGIN_NS + random.randrange(length_ns), "tune"


def _play(stage: Stage, program: Program, plan: Plan, random: Random) -> None:
    """Run a program from its deployment on; `random` draws the values of its tunable params."""
    frame_ns = program.robot.frame_ns
    stage.lead()
    operator = stage.operator()
    moments = [
        (BEGIN_NS + i * frame_ns + frame_ns * 9 // 10, "set") for i in range(plan.length_ns // frame_ns)
    ]
    for t_ns, what in sorted((*moments, *plan.events)):
        stage.run_until(t_ns)
        stage.leader.keep_alive()
        operator.keep_alive()
        match what:
            case "set":
                known = {n: v for n, v in stage.plant.read(DSERVER.name).items() if v is not None}
                with suppress(OverflowError):  # a reading that no variable can have
                    operator.ask(DSERVER.name, data.set_many(known))
            case "stop":
                stage.stop(operator)
            case "release":
                operator.ask("Clock", clock.release())
            case "tune":
                operator.ask("Clock", clock.tune(draw_values(program, random)))
            case "leave":
                stage.leave()
            case "lead":
                stage.lead()
            case _:
                raise ValueError(what)


def _result(
    program: Program,
    heard: Sequence[Heard],
    commands: Sequence[Command],
    logs: list[RunFrame],
    *,
    in_order: bool,
) -> Run:
    """Return what came of a run.

    With `in_order`, each sender is heard in the order in which it sent, and as often.
    """
    by_topic: dict[str, dict[object, str]] = {}
    ranked = sorted(
        (h.t_ns, h.topic, sender(h.message), i if in_order else 0, as_text(h.message), i)
        for i, h in enumerate(heard)
    )
    for t_ns, topic, _, _, text, i in ranked:
        by_topic.setdefault(topic, {}).setdefault(i if in_order else text, f"{t_ns}: {text}")
    report = audit(program, logs)
    compared = {
        **{f"heard on {topic}": list(texts.values()) for topic, texts in by_topic.items()},
        "frames": [canonical(log) for log in logs],
        "commands": [repr(c) for c in sorted(commands, key=lambda c: c[:3])],
        "audit": [repr(report)],
    }
    wrong = [f"frame {log.tick.k}: {text}" for log in logs for text in log.disagreements]
    if not report.agrees:
        wrong.append(f"the audit does not agree: {report.first}")
    if not logs:
        wrong.append("no frame was seen")
    return Run(compared, tuple(wrong))


def sender(message: SentMessage) -> str:
    """Return what messages of one sender have in common, as far as their order counts."""
    for name in ("client", "server", "actuator", "module", "connection"):
        found = getattr(message, name, None)
        if found is not None:
            return f"{type(message).__name__} {found}"
    return type(message).__name__


def as_text(message: SentMessage) -> str:
    """Return a message as text, its encoded parts included. Void frames have no order."""
    if isinstance(message, Tick):
        message = _without_order(message)
    elif isinstance(message, Ready) and message.progress is not None:
        ticks = tuple(map(_without_order, message.progress.ticks))
        message = msgspec.structs.replace(
            message, progress=msgspec.structs.replace(message.progress, ticks=ticks)
        )
    return repr(msgspec.msgpack.decode(msgspec.msgpack.encode(message)))


def _without_order(tick: Tick) -> Tick:
    return msgspec.structs.replace(tick, void=tuple(sorted(tick.void)))


def canonical(log: RunFrame) -> str:
    """Return a frame as text, without the order in which its parts arrived."""
    return repr(
        (
            as_text(log.tick),
            log.frame.t_ns,
            sorted(log.frame.readings.items()),
            sorted(log.verdicts.items()),
            log.expected,
            log.restart,
            sorted(repr(r) for r in log.requests if not _is_unheard(log, r)),
            log.skipped,
            log.keyframe,
            sorted(log.answers.items()),
        )
    )


def _is_unheard(log: RunFrame, request: Request) -> bool:
    """Return True for a request that came too late to count: the recording has it if it came soon enough."""
    verdict = log.verdicts.get(request.actuator)
    return verdict is None or dict(verdict.fates).get(request.client) in UNHEARD


def differences(a: Run, b: Run) -> Iterator[str]:
    """Yield the first difference of each kind."""
    for what in sorted({*a.compared, *b.compared}):
        one, other = a.compared.get(what, []), b.compared.get(what, [])
        if one != other:
            i = next(
                (i for i, (x, y) in enumerate(zip(one, other, strict=False)) if x != y),
                min(len(one), len(other)),
            )
            x, y = (("nothing more" if i >= len(z) else z[i]) for z in (one, other))
            yield f"{what}, {len(one)} and {len(other)}, at {i}: {x} | {y}"


ATTEMPTS = 5
"""Number of further runs in two layouts that differ, until a run in one equals a run in the other.

Messages are held up at random in these runs, so that the hosts handle those of one moment in other orders.
"""


def compare(seed: int, layouts: tuple[str, ...] | None = None) -> tuple[Counter[str], list[str]]:
    """Run the program of a seed in several layouts; return counts and what differs."""
    drawn, trace = run_of_seed(seed, network=bool(seed % 2), sequence=seed % 4 == 0)
    program = on_devices(with_tunables(drawn, Random(f"tunables {seed}")))
    compiled = compile_program(program).compiled
    readings = [frame.readings for frame in trace]
    chosen = layouts or ("run", "served" if seed % 4 < 2 else "mission", "isolated")
    runs = {layout: [run_in(layout, program, compiled, readings, seed)] for layout in chosen}
    one, *others = chosen
    counts = Counter(programs=1, frames=len(runs[one][0].compared["frames"]))
    counts["tunings"] = TUNINGS * any(s.tunable for s in program.robot.sensors)
    counts["messages"] = sum(len(v) for k, v in runs[one][0].compared.items() if k.startswith("heard"))
    found = list[str]()
    for other in others:
        attempt, first = 0, list(differences(runs[one][0], runs[other][0]))
        while attempt < ATTEMPTS and not _have_equal(runs[one], runs[other]):
            attempt += 1
            for layout in (one, other):
                runs[layout].append(run_in(layout, program, compiled, readings, seed, attempt))
        counts["in another order"] += attempt > 0 and _have_equal(runs[one], runs[other])
        if not _have_equal(runs[one], runs[other]):
            found += [f"seed {seed}, {one} and {other}: {text}" for text in first]
    wrong = {
        f"seed {seed}, {layout}: {text}" for layout in runs for run in runs[layout] for text in run.wrong
    }
    return counts, [*sorted(wrong), *found]


def _have_equal(some: list[Run], others: list[Run]) -> bool:
    return any(one.compared == other.compared for one in some for other in others)
