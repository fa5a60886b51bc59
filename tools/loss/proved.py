"""What is proved holds in runs: drawn programs in the runtime, in virtual time, with faults and operators.

Each seed is a program with drawn contracts, and one for each limit, which `verify` proves with a small
budget. Then the monitor of a run in which processes die, freeze and come back, and messages are late or lost,
never reports a contract that is proved while clients are late; nor, where commands from outside are drawn
besides, for any of the actuators, one that is proved with operators; nor, where nothing of that happens, one
that is proved at all.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from random import Random
from typing import Literal, NamedTuple

from colony.ir import expression as ir
from colony.ir.frame import Frame
from colony.ir.program import Actuator, ActuatorField, Contract, Program
from colony.ir.servers import DSERVER
from colony.ir.types import BOOL, Bool, Enum, ScalarValue
from colony.runtime.arbitration.ballot import STOPPED, Interventions, OutsideCommand
from colony.runtime.assembly.scripted import ActuatorServer, Readings, SentCommand
from colony.runtime.protocol.deployment import Deployment
from colony.runtime.protocol.messages import Bounds, Effect, Message, Tick
from colony.runtime.transport.faults import FaultRates, LinkFaults
from colony.verify.claims import any_of, binary, constant, implies, value_or
from colony.verify.contracts.prove import prove_contracts
from colony.verify.contracts.results import ProofOptions, Proved, ProvedInTime
from tests.drawn.strategies import run_of_seed
from tools.drawn_programs import Holding, with_weaker_contracts
from tools.loss.oracle import observed, plan
from tools.loss.seeds import named
from tools.loss.stage import Robot

FRAMES = 60
OPTIONS = ProofOptions(depth=2, max_frames=2, resources=300_000)

Kind = Literal["always", "late", "operators"]
"""What happens in a run: nothing, or faults, or commands from outside besides."""


class Operators(ActuatorServer):
    """A server whose actuators are commanded from outside, too, or stopped, as drawn from `random`."""

    def __init__(
        self,
        deployed: Deployment,
        readings: Readings,
        frames_kept: int,
        sent: list[SentCommand],
        *,
        actuators: tuple[Actuator, ...],
        random: Random,
    ) -> None:
        super().__init__(deployed, readings, frames_kept, sent)
        self._actuators, self._random = actuators, random
        self._driven = frozenset[str]()

    def handle(self, message: Message, now_ns: int) -> Iterator[Effect]:
        if isinstance(message, Bounds):
            yield from self._commands.bounds(message, now_ns)
            return
        yield from super().handle(message, now_ns)
        if isinstance(message, Tick) and message.run:
            if self._random.random() < 0.2:
                self._driven = frozenset(a.name for a in self._actuators if self._random.random() < 0.5)
            for actuator in self._actuators:
                if actuator.name in self._driven:
                    command = drawn_command(self._random, actuator)
                    yield from self._commands.intervene(actuator.name, command, now_ns)


def drawn_command(random: Random, actuator: Actuator) -> Interventions:
    """A command within the range, as servers see to it, above or below the modules; or a stop."""
    if random.random() < 0.1:
        return STOPPED
    values = tuple(drawn_value(random, f) for f in actuator.fields)
    return Interventions((OutsideCommand("op/1", random.choice((1_000_000, 1_000_000, -1)), values),))


def drawn_value(random: Random, field: ActuatorField) -> ScalarValue:
    match field.type:
        case Bool():
            return random.random() < 0.5
        case Enum(members=members):
            return random.choice(members)[1]
        case _:
            low = -1000.0 if field.low is None else field.low
            high = max(low, 1000.0) if field.high is None else field.high
            return random.choice((low, high, min(max(0.0, low), high), random.uniform(low, high)))


class Proofs(NamedTuple):
    """A program, and which of its contracts are proved."""

    program: Program
    proved: Holding

    def holding(self, kind: Kind) -> set[str]:
        """The contracts that hold in a run."""
        return {"always": self.proved.always, "late": self.proved.late, "operators": self.proved.operators}[
            kind
        ]


def with_limits(program: Program) -> Program:
    """The program with a contract for each limit: it holds where its actuator is commanded."""
    contracts = []
    for i, limit in enumerate(program.limits):
        (actuator,) = (a for a in program.robot.actuators if a.name == limit.actuator)
        type_ = actuator.fields[limit.field_index].type
        sent = ir.SentField(type=type_, actuator=limit.actuator, field_index=limit.field_index)
        relation = ir.Binary.LESS_EQUAL if limit.relation == "<=" else ir.Binary.GREATER_EQUAL
        held = binary(relation, sent, limit.bound)
        if limit.condition is not None:
            held = implies(limit.condition, held)
        idle = ir.IsIdle(type=BOOL, actuator=limit.actuator)
        true = constant(True, BOOL)
        contracts.append(Contract(name=f"limit_{i}", expression=any_of((idle, value_or(held, true)))))
    return replace(program, contracts=(*program.contracts, *contracts))


def proofs(program: Program) -> Proofs:
    """Prove the contracts of a program with a small budget."""
    holding = Holding(set(), set(), set())
    for result in prove_contracts(program, OPTIONS):
        name = result.contract.name
        match result:
            case Proved(operators=operators):
                holding.always.add(name)
                holding.late.add(name)
                holding.operators.update({name} if operators else ())
            case ProvedInTime():
                holding.always.add(name)
            case _:
                pass
    return Proofs(program, holding)


def run(seed: int) -> Counter[str]:
    """One program; gives what happened.

    Raises:
        AssertionError: a contract is broken that is proved; the message begins with the seed.
    """
    random = Random(seed)
    program, trace = run_of_seed(seed, max_frames=16)
    if len(program.robot.actuators) < 2:
        return Counter({"programs with one actuator, not run": 1})
    found = proofs(with_limits(with_weaker_contracts(program, random)))
    counts = Counter(programs=1)
    kinds: tuple[Kind, ...] = ("always", "late", "operators", "operators")
    for number, kind in enumerate(kinds):
        holding = found.holding(kind)
        counts[f"contracts proved: {kind}"] += len(holding)
        if not holding:
            continue
        sent = {s.name for s in program.robot.sensors if s.sent}
        given = {} if random.random() < 0.3 else dict.fromkeys(sent)
        frames = [f._replace(readings={n: v for n, v in f.readings.items() if n not in given}) for f in trace]
        with named(f"seed {seed}, {kind}, run {number}"):
            counts += run_one(found.program, frames, kind, Random(f"{seed} {number}"), holding)
    return counts


def run_one(
    program: Program, trace: list[Frame], kind: Kind, random: Random, holding: set[str]
) -> Counter[str]:
    """One run; gives what happened in it."""
    frame_ns, share = program.robot.frame_ns, random.choice((0.0, 0.3, 1.0, 2.0))
    rates = FaultRates(
        lost=0.02 * share,
        duplicated=0.02 * share,
        late=0.03 * share,
        reordered=0.1 * share,
        late_ns=min(120_000_000, 3 * frame_ns),
        reordered_ns=min(2_000_000, frame_ns // 4),
    )
    if kind == "always":
        rates = FaultRates(lost=0.0, duplicated=0.0, late=0.0, reordered=0.0)

    def exempt(sender: str, receiver: str, message: Message) -> bool:
        return receiver == "Observer"

    limited = {
        limit.actuator for limit in program.limits
    }  # of DServer nobody computes the bounds of each frame
    driven = [a for a in program.robot.actuators if a.server != DSERVER.name or a.name not in limited]
    server = (
        partial(Operators, actuators=tuple(driven), random=random) if kind == "operators" else ActuatorServer
    )
    robot = Robot(
        program,
        trace,
        frame_ns=frame_ns,
        seed=random.randrange(1000),
        link=LinkFaults(random.randrange(1000), rates, exempt=exempt),
        isolate=random.random() < 0.5,
        actuator_server=server,
    )
    if kind != "always":
        plan(robot, random, FRAMES * frame_ns * 3 // 4)
    robot.run(FRAMES)
    return check(robot, kind, holding)


def check(robot: Robot, kind: Kind, holding: set[str]) -> Counter[str]:
    """The monitor reports no contract that holds."""
    counts = Counter[str]()
    for log in observed(robot):
        broken = holding.intersection(log.expected.breaches)
        assert not broken, (
            f"frame {log.tick.k}: {sorted(broken)} broken, although proved; sent {log.verdicts}"
        )
        counts[f"frames: {kind}"] += 1
        counts["frames with unknown memory"] += log.memory_unknown
        counts["breaches of others"] += len(log.expected.breaches)
        verdicts = log.verdicts.values()
        counts["commands from outside"] += sum(v.outside is not None and v.fault is None for v in verdicts)
        counts["commands from outside that could not be sent"] += sum(
            v.outside is not None and v.fault is not None for v in verdicts
        )
        counts["verdicts with clients late or lost"] += sum(
            any(f in ("late", "lost") for _, f in v.fates) for v in verdicts
        )
    return counts
