"""The commands of a controller that is not colony's, judged by the contracts of a program.

The contracts see what the actuators were given by that controller: its command in place of the network's, and
the idle command while it gives none. `last.ACTUATOR.FIELD` and all memory follow these commands.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from colony.execute.compiled import Compiled
from colony.execute.executor import ProgramExecutor
from colony.ir.expression import IsActive, WonBy, subexpressions
from colony.ir.frame import Answer, Frame, OverriddenCommand
from colony.ir.program import Program, in_base_units, in_declared_units
from colony.ir.types import ScalarValue, Value
from colony.ir.walk import actuators_named
from colony.runtime.frames.run_frame import HeardCommand
from colony.runtime.protocol.bindings import ActuatorBinding


def unjudged(program: Program, actuators: Iterable[str]) -> dict[str, str]:
    """Return the contracts that another controller's commands cannot be judged by, each with the reason.

    Args:
        program: the program.
        actuators: the actuators whose commands are heard.
    """
    heard, found = frozenset(actuators), dict[str, str]()
    for contract in program.contracts:
        if contract.is_assumption:
            continue  # which is about the world
        parts = (e for e in subexpressions(contract.expression) if isinstance(e, WonBy | IsActive))
        named = next((f"`{e.module if isinstance(e, WonBy) else e.name}`" for e in parts), None)
        silent = [a for a in actuators_named(contract.expression) if a not in heard]
        if named is not None:
            found[contract.name] = f"it is about {named} of the program"
        elif silent:
            found[contract.name] = f"`{silent[0]}` has no topic that is heard"
    return found


class Controller:
    """Judges the commands of another controller, frame by frame. Mutable: holds the program's memory.

    Args:
        compiled: the program.
        bindings: the actuators whose commands are heard.
        unjudged: the contracts that are left out.
    """

    def __init__(
        self, compiled: Compiled, bindings: Iterable[ActuatorBinding], unjudged: Iterable[str] = ()
    ) -> None:
        self.bindings = tuple(bindings)
        self._actuators = {a.name: a for a in compiled.robot.actuators}
        self._unjudged = frozenset(unjudged) | {c.name for c in compiled.contracts if c.assumed}
        self._executor = ProgramExecutor(compiled, simplified=False, answers_given=True)

    def restart(self) -> None:
        """Restart all memory."""
        self._executor.restart()

    def command(self, binding: ActuatorBinding, parameters: Value, age_ns: int) -> HeardCommand:
        """Return a command from the parameters that a server published, in base units."""
        fields = self._actuators[binding.actuator].fields
        assert isinstance(parameters, tuple), "a command has its parameters in a tuple"
        values: list[ScalarValue] = [0.0] * len(fields)
        for value, index in zip(parameters, binding.field_indices, strict=False):
            if index is not None:
                values[index] = value
        declared = in_declared_units(tuple(values), fields)
        assert declared is not None, "a command has values"
        return HeardCommand(declared, age_ns)

    def breaches(
        self, frame: Frame, heard: Mapping[str, HeardCommand | None], answers: Mapping[str, Answer]
    ) -> tuple[str, ...]:
        """Step over a frame without `last` sensors, in declared units; return the contracts broken in it."""
        given = {
            name: OverriddenCommand(
                None if command is None else in_base_units(command.values, self._actuators[name].fields)
            )
            for name, command in heard.items()
        }
        broken = self._executor.step(frame, answers, given).breaches
        return tuple(name for name in broken if name not in self._unjudged)
