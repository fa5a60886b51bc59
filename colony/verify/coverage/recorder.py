"""The goals that frames of the reference interpreter reach."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from colony.ir.expression import MemoryCall, subexpressions
from colony.ir.memory import ProgramMemory, window_cell
from colony.ir.program import Example
from colony.ir.walk import wiring_graph
from colony.verify.coverage.obligations import CoveragePlan
from colony.verify.reference.interpreter import Interpreter
from colony.verify.snapshot import Snapshot
from colony.verify.testing.frames import snapshots_of


class Recorder:
    """The goals seen so far, and the number of frames. Stateful."""

    def __init__(self, plan: CoveragePlan) -> None:
        self._plan = plan
        self._unseen = dict(plan.goals)
        self.seen: set[str] = set()
        self.frames = 0

    def look(self, interpreter: Interpreter) -> None:
        """Record the goals that are true in the last frame of an interpreter of the instrumented program."""
        self.frames += 1
        found = [n for n, goal in self._unseen.items() if interpreter.value_of(goal.condition) is True]
        for name in found:
            del self._unseen[name]
        self.seen.update(found)

    def leave_out_remembering(self) -> None:
        """Leave out the goals with memory of their own, for frames before which it is unknown."""
        for name, goal in tuple(self._unseen.items()):
            if any(isinstance(x, MemoryCall) for x in subexpressions(goal.condition)):
                del self._unseen[name]

    def run(self, snapshots: Iterable[Snapshot]) -> bool:
        """Record the goals of a run that begins with initial memory; return True if all assumptions hold."""
        interpreter = Interpreter(self._plan.watching)
        holds = self._plan.holds(self._plan.assumed)
        is_possible = True
        for s in snapshots:
            interpreter.step_in_base_units(s.t_ns, s.readings, s.lost, s.given, restarted=s.restarted)
            self.look(interpreter)
            is_possible = is_possible and interpreter.value_of(holds) is True
        return is_possible

    def run_tests(self, tests: Iterable[Example]) -> None:
        """Record the goals of tests.

        Raises:
            DiagnosticError: a module in Python cannot be imported and built.
        """
        for test in tests:
            self.run(snapshots_of(self._plan.program, test))


def seen_in(plan: CoveragePlan, snapshots: Iterable[Snapshot]) -> frozenset[str]:
    """Return the goals of a run, none of one that breaks an assumption."""
    recorder = Recorder(plan)
    return frozenset(recorder.seen) if recorder.run(snapshots) else frozenset()


def with_renamed_windows(plan: CoveragePlan, memory: ProgramMemory) -> ProgramMemory:
    """Return memory of the program as memory of the instrumented one, in which each node is a wire."""
    names = {}
    for node in wiring_graph(plan.program).nodes:
        wire, *operands = node.path
        names[window_cell(str(wire), tuple(int(i) for i in operands))] = window_cell(node.name, (0,))
    cells = {}
    for cell, value in memory.cells.items():
        prefix, separator, rest = cell.rpartition(" ")
        cells[f"{names.get(prefix, prefix)}{separator}{rest}"] = value
    return replace(memory, cells=cells)
