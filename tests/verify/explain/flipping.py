"""What an answer says had to change, changed: does the interpreter decide otherwise?

The check shares nothing with the formulas of an answer. It rewrites the program, so that a condition has the
opposite value, gives the interpreter the state before the frame, and lets it decide the frame again.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass, replace
from random import Random

from colony.analysis.moments import MomentFollower
from colony.dsl.load import load_text
from colony.ir import expression as ir
from colony.ir.frame import Frame
from colony.ir.program import Let, Machine, Module, Program, State
from colony.ir.types import BOOL, Array, ScalarValue, any_value
from colony.runtime.frames.run_frame import RunFrame
from colony.runtime.protocol.messages import Tick
from colony.verify.explain.answer import Explanation, Why, WhyNot, explain
from colony.verify.explain.causes import Present
from colony.verify.explain.formula import Leaf
from colony.verify.reference.interpreter import Interpreter
from colony.verify.reference.memory import InterpreterState
from colony.verify.testing.frames import Choices, draw_trace
from tests.drawn.networks import draw_network
from tests.drawn.program_text import draw_text

FRAMES = 8


def drawn_run(seed: int, *, network: bool) -> tuple[Program, tuple[Frame, ...]]:
    """Return a program without modules in Python, and frames for it."""
    choices = Choices(Random(seed))
    program = draw_network(choices, 6, 5) if network else load_text(draw_text(choices, False))
    return program, draw_trace(choices, program, FRAMES)


def recorded(frame: Frame, k: int) -> RunFrame:
    """Return a frame as a recording has it, of which nothing but the readings is known."""
    return RunFrame(tick=Tick(k=k, t_ns=frame.t_ns), frame=frame, verdicts={})


@dataclass(frozen=True, slots=True, kw_only=True)
class Asked:
    """An answer, with what the interpreter needs to decide its frame again."""

    program: Program
    before: InterpreterState | None
    frame: Frame
    explanation: Explanation
    outcome: Callable[[Interpreter], bool]


def asked(program: Program, trace: tuple[Frame, ...]) -> Iterator[Asked]:
    """Yield an answer for each module of each frame, and for each actuator."""
    follower = MomentFollower(program)
    for k, frame in enumerate(trace):
        before = follower.checkpoint.state
        moment = follower.take(recorded(frame, k))
        assert moment is not None
        for module in program.modules:
            is_active = _is_active(module.name)
            yield Asked(
                program=program,
                before=before,
                frame=frame,
                explanation=explain(moment, Why(module.name)),
                outcome=is_active,
            )
            if module.actuator is not None:
                yield Asked(
                    program=program,
                    before=before,
                    frame=frame,
                    explanation=explain(moment, WhyNot(module.name)),
                    outcome=_is_by(module.actuator, module.name),
                )


def _is_active(module: str) -> Callable[[Interpreter], bool]:
    return lambda interpreter: interpreter.is_active(module)


def _is_by(actuator: str, module: str) -> Callable[[Interpreter], bool]:
    return lambda interpreter: interpreter.values.winners[actuator] == module


def findings(asked: Asked, counts: Counter[str]) -> Iterator[str]:
    """Yield what is wrong with an answer, and count what was checked."""
    explanation = asked.explanation
    subject = f"{explanation.claim} ({explanation.k})"
    if _outcome(asked, ()) != explanation.holds:
        yield f"{subject}: the answer says {explanation.holds}"
        return
    counts["answers"] += 1
    counts["no change"] += not explanation.changes
    for suggested in explanation.changes:
        change = suggested.leaves
        if any(isinstance(leaf.cause, Present) for leaf in change):
            counts["readings"] += 1
            yield from _readings_findings(asked, subject)
        if not suggested.is_certain:
            counts["uncertain"] += 1
            continue
        counts["single" if len(change) == 1 else "several"] += 1
        if _outcome(asked, change) == explanation.holds:
            yield f"{subject}: no other outcome with {[leaf.cause for leaf in change]} changed"
        for leaf in change if len(change) > 1 else ():
            if _outcome(asked, (leaf,)) != explanation.holds:
                yield f"{subject}: {leaf.cause} suffices"


def _readings_findings(asked: Asked, subject: str) -> Iterator[str]:
    """Yield what is wrong with an answer by which a sensor had to be there: is the module silent with it?"""
    changes = asked.explanation.changes
    module = asked.explanation.claim.split()[0]
    absent = {leaf.key[1] for change in changes for leaf in change.leaves if not leaf.holds}
    if not absent or asked.explanation.claim != f"{module} is active":
        return
    readings = dict(asked.frame.readings)
    for sensor in asked.program.robot.sensors:
        if sensor.name in absent:
            is_array = isinstance(sensor.type, Array)
            value = any_value(sensor.type.element if is_array else sensor.type)  # type: ignore[union-attr]
            readings[sensor.name] = (value,) * sensor.type.size if is_array else value  # type: ignore[union-attr]
    taken = {n: t for n, t in asked.frame.taken_ns.items() if n not in absent}
    interpreter = _decided(
        asked.program, asked.before, asked.frame._replace(readings=readings, taken_ns=taken)
    )
    if interpreter.is_silent(module) or interpreter.is_blind(module):
        yield f"{subject}: {module} has no answer with {absent}"


def _outcome(asked: Asked, change: Collection[Leaf]) -> bool:
    program, before = asked.program, asked.before
    for leaf in change:
        match leaf.key:
            case ("window", *path):
                before = _with_window(before, tuple(path), None if leaf.holds else asked.frame.t_ns)
            case _:
                program = rewritten(program, leaf)
    return asked.outcome(_decided(program, before, asked.frame))


def _decided(program: Program, before: InterpreterState | None, frame: Frame) -> Interpreter:
    interpreter = Interpreter(program)
    if before is not None:
        interpreter.restore(before)
    interpreter.step(frame)
    return interpreter


def _with_window(
    before: InterpreterState | None, path: tuple[str | int, ...], at_ns: int | None
) -> InterpreterState | None:
    assert before is not None, "nothing dominates by its past in the first frame"
    last = {node: t for node, t in before.memory.last_active_ns.items() if node != path}
    if at_ns is not None:
        last[path] = at_ns
    return before._replace(memory=before.memory._replace(last_active_ns=last))


# --- programs rewritten ----------------------------------------------------------------------------


def rewritten(program: Program, leaf: Leaf) -> Program:
    """Return the program in which a condition has the opposite value."""
    assert leaf.node is not None, leaf
    opposite = constant(not leaf.holds)
    node = leaf.node

    def change(e: ir.Expression) -> ir.Expression:
        if isinstance(node, ir.MemoryCall):
            inner = ir.rebuilt(e, change)
            is_it = isinstance(inner, ir.MemoryCall) and inner.cell == node.cell
            return _recalled(inner, leaf) if is_it and isinstance(inner, ir.MemoryCall) else inner
        if e == node:
            return opposite
        return ir.rebuilt(e, change)

    return mapped(program, change)


def _recalled(e: ir.MemoryCall, leaf: Leaf) -> ir.Expression:
    """Return a memory function whose past is the opposite; what it reads now stays."""
    now, remembered = e.arguments, constant(not leaf.holds)
    match e.function, leaf.key[0]:
        case (ir.MemoryFunction.RECENTLY, "past"):
            return _operation(ir.Binary.OR, remembered, now[0])
        case (ir.MemoryFunction.SUSTAINED, "past"):
            return _operation(ir.Binary.AND, remembered, now[0])
        case (ir.MemoryFunction.LATCH, "memory"):
            reset = ir.UnaryOperation(type=BOOL, operator=ir.Unary.NOT, operand=now[1])
            return _operation(ir.Binary.AND, _operation(ir.Binary.OR, remembered, now[0]), reset)
        case (ir.MemoryFunction.RISING, "memory"):
            return _operation(ir.Binary.AND, now[0], constant(leaf.holds))
        case (ir.MemoryFunction.FALLING, "memory"):
            return _operation(
                ir.Binary.AND, remembered, ir.UnaryOperation(type=BOOL, operator=ir.Unary.NOT, operand=now[0])
            )
        case _:
            return remembered


def constant(value: ScalarValue) -> ir.Constant:
    """Return a bool as an expression."""
    return ir.Constant(type=BOOL, value=value)


def _operation(operator: ir.Binary, left: ir.Expression, right: ir.Expression) -> ir.Expression:
    return ir.BinaryOperation(type=BOOL, operator=operator, left=left, right=right)


def mapped(program: Program, change: Callable[[ir.Expression], ir.Expression]) -> Program:
    """Return a program in which the expressions of derived values and modules are changed."""
    return replace(
        program,
        derived=tuple(_derived(d, change) for d in program.derived),
        modules=tuple(_module(m, change) if isinstance(m, Module) else m for m in program.modules),
        limits=(),
        contracts=(),
    )


def _derived(
    d: Let | State | Machine, change: Callable[[ir.Expression], ir.Expression]
) -> Let | State | Machine:
    match d:
        case Let():
            return replace(d, expression=change(d.expression))
        case State():
            return d if d.next is None else replace(d, next=change(d.next))
        case Machine():
            transitions = tuple(replace(t, condition=change(t.condition)) for t in d.transitions)
            return replace(d, transitions=transitions)


def _module(module: Module, change: Callable[[ir.Expression], ir.Expression]) -> Module:
    states = tuple(s if s.next is None else replace(s, next=change(s.next)) for s in module.states)
    lets = tuple(replace(let, expression=change(let.expression)) for let in module.lets)
    command = module.command
    if command is not None:
        command = replace(command, fields=tuple(change(e) for e in command.fields))
    return replace(module, lets=lets, states=states, when=change(module.when), command=command)
