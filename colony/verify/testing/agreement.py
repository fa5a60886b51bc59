"""Agreement of all executors of a program: each is compared with the reference interpreter.

Outcomes are compared bit for bit: -0.0 is not 0.0, and NaN is NaN.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from types import MappingProxyType

from colony.compile.backends.python.generate import generate, load
from colony.compile.pipeline import Compilation, compile_program
from colony.execute.executor import ClientsExecutor, ClientStep, ModuleExecutor, ProgramExecutor
from colony.execute.intake import converted
from colony.ir.frame import Decision, Executor, Frame, Outcome
from colony.ir.program import Program, PythonModule, in_declared_units, value_before
from colony.ir.types import ScalarValue
from colony.verify.reference.interpreter import Interpreter

Factory = Callable[[Compilation], Executor]
"""A function that makes an executor of a compiled program, with its initial memory."""


def _clients(compilation: Compilation) -> Executor:
    return ProgramExecutor(compilation.compiled)


def _exclusive_clients(compilation: Compilation) -> Executor:
    return ProgramExecutor(compilation.compiled, exclusive=True)


def _generated_python(compilation: Compilation) -> Executor:
    return load(generate(compilation.compiled))


EXECUTORS: Mapping[str, Factory] = MappingProxyType(
    {
        "clients by priority": _clients,
        "clients by exclusive guards": _exclusive_clients,
        "generated Python": _generated_python,
    }
)
"""All executors of the compiled form in this process."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Disagreement:
    """The first frame in which the outcome of `executor` is not that of the reference interpreter.

    `trace` ends with that frame. `found` is an outcome, or the exception raised instead of one. `str` shows
    the frames and what differs.
    """

    executor: str
    trace: tuple[Frame, ...]
    expected: Outcome
    found: Outcome | str

    def __str__(self) -> str:
        """Return the trace, and what was expected and found."""
        lines = [f"{self.executor}: differs from the reference in frame {len(self.trace) - 1}"]
        lines += [f"  frame {i}: t = {f.t_ns} ns, {dict(f.readings)}" for i, f in enumerate(self.trace)]
        if isinstance(self.found, str):
            return "\n".join((*lines, f"  expected: {self.expected}", f"  raised:   {self.found}"))
        for name, expected, found in zip(Outcome._fields, self.expected, self.found, strict=True):
            if repr(expected) != repr(found):
                lines += [f"  expected {name}: {expected}", f"  found {name}:    {found}"]
        return "\n".join(lines)


def reference(program: Program, trace: Sequence[Frame]) -> tuple[Outcome, ...]:
    """Return the outcomes of the reference interpreter over `trace`, from its initial memory."""
    interpreter = Interpreter(program)
    return tuple(interpreter.step(frame) for frame in trace)


def disagreement(
    program: Program,
    trace: Sequence[Frame],
    executors: Mapping[str, Factory] = EXECUTORS,
    expected: Sequence[Outcome] | None = None,
    compilation: Compilation | None = None,
) -> Disagreement | None:
    """Return the disagreement of the first executor that differs from the reference, if any does.

    Each executor starts from its initial memory. An exception in an executor is a disagreement, too; one in
    the compiler is raised. `expected` (from `reference`) and `compilation` are computed if not given.
    """
    outcomes = reference(program, trace) if expected is None else expected
    compilation = compile_program(program) if compilation is None else compilation
    for name, make in executors.items():
        found = _first_difference(make, compilation, trace, outcomes)
        if found is not None:
            index, outcome = found
            return Disagreement(
                executor=name, trace=tuple(trace[: index + 1]), expected=outcomes[index], found=outcome
            )
    return None


def _first_difference(
    make: Factory, compilation: Compilation, trace: Sequence[Frame], expected: Sequence[Outcome]
) -> tuple[int, Outcome | str] | None:
    index = 0
    try:
        executor = make(compilation)
        for index, frame in enumerate(trace):
            outcome = executor.step(frame)
            if repr(outcome) != repr(expected[index]):
                return index, outcome
    except Exception as raised:  # an exception of any kind is a finding
        return index, f"{type(raised).__name__}: {raised}"
    return None


# --- clients that have only their own view -------------------------------------------------------


class Clients:
    """The clients of a program (an `ir.frame.Executor`). Stateful: holds all memory.

    They run as in the runtime, each on its own view of the program, or all in one process. A decision is the
    one that the server would make from their requests: in each frame only the winner must be active, with a
    command or the fault that it has instead. Python modules run alone, and the clients receive their answers.
    Records and breaches are the reference's, since clients have none.

    Raises:
        DiagnosticError: the class of a Python module cannot be imported or built.
    """

    def __init__(self, compilation: Compilation, *, alone: bool) -> None:
        self._program = compilation.program
        self._interpreter = Interpreter(compilation.program)
        keys = [(actuator, module) for actuator, module, _ in compilation.compiled.clients]
        groups = [(key,) for key in keys] if alone else [tuple(keys)]
        self._processes = [ClientsExecutor(compilation.compiled, clients) for clients in groups]
        self._sent: dict[str, ScalarValue] = {}  # values of `last...`
        self._modules = {
            module: ModuleExecutor(compilation.compiled, module)
            for module in compilation.compiled.python_modules
        }

    def step(self, frame: Frame) -> Outcome:
        """Decide one frame."""
        expected = self._interpreter.step(frame)
        base_frame = frame_in_base_units(
            self._program, frame._replace(readings={**self._sent, **frame.readings})
        )
        answers = {name: module.step(base_frame) for name, module in self._modules.items()}
        steps = {
            client: step
            for process in self._processes
            for client, step in zip(process.clients, process.step(base_frame, answers), strict=True)
        }
        outcome = expected._replace(
            decisions=tuple(_decide(self._program, d, steps) for d in expected.decisions)
        )
        self._remember(outcome, {module for (_, module), step in steps.items() if step.bid in _ACTIVE})
        return outcome

    def _remember(self, outcome: Outcome, active: set[str]) -> None:
        """Remember what servers publish of a frame in the next one, given its `active` clients."""
        for sensor in self._program.robot.sensors:
            if sensor.sent is not None:
                d = outcome.commands[sensor.sent.actuator]
                value = value_before(sensor.sent.of, d.values, d.by, active.__contains__)
                if value is not None:
                    self._sent[sensor.name] = value

    def restart(self) -> None:
        """Restart from the initial memory, with new instances of the Python modules."""
        self._interpreter = Interpreter(self._program)
        self._sent.clear()
        for process in self._processes:
            process.restart()
        for module in self._modules.values():
            module.restart()


def frame_in_base_units(program: Program, frame: Frame) -> Frame:
    """Return a frame in base units, for the executors of clients."""
    factors = {s.name: s.factor for s in program.robot.sensors if s.factor != 1.0}
    readings = {
        name: converted(reading, factors[name].__mul__) if name in factors else reading
        for name, reading in frame.readings.items()
    }
    return frame._replace(readings=readings)  # type: ignore[arg-type]


_ACTIVE = ("command", "suppressed", "inhibited")
"""Bids of clients whose modules are active."""


CLIENTS: Mapping[str, Factory] = MappingProxyType(
    {"clients alone": partial(Clients, alone=True), "clients together": partial(Clients, alone=False)}
)
"""The clients of the compiled form, each by itself and all in one process."""

ALL_EXECUTORS: Mapping[str, Factory] = MappingProxyType({**EXECUTORS, **CLIENTS})
"""All executors, the clients included."""


def client_disagreement(program: Program, trace: Sequence[Frame]) -> Disagreement | None:
    """Return the first disagreement of the clients, alone or together, with the reference, if any."""
    return disagreement(program, trace, CLIENTS)


def generated_c(compilation: Compilation) -> Executor:
    """Return an executor in C; see `colony.compile.backends.c.native.load_c`."""
    from colony.compile.backends.c.native import load_c  # needs an extra

    return load_c(compilation.compiled)


def with_c(program: Program, executors: Mapping[str, Factory] = ALL_EXECUTORS) -> Mapping[str, Factory]:
    """Return executors, with generated C where it can be compiled: not where a module is in Python."""
    from colony.compile.backends.c.native import is_available

    has_python = any(isinstance(module, PythonModule) for module in program.modules)
    return executors if has_python or not is_available() else {**executors, "generated C": generated_c}


def _decide(program: Program, expected: Decision, steps: Mapping[tuple[str, str], ClientStep]) -> Decision:
    """Return the decision that the server would make from all requests of an actuator's clients."""
    active = [(m, step) for (a, m), step in steps.items() if a == expected.actuator and step.active]
    actuator = next(a for a in program.robot.actuators if a.name == expected.actuator)
    winner = " and ".join(m for m, _ in active) or None
    values = active[0][1].values if len(active) == 1 else None
    sent = actuator.idle if values is None else values
    declared = in_declared_units(sent, actuator.fields)
    return Decision(actuator.name, winner, declared, active[0][1].fault if active else None)
