"""Parts that share a process: how one starts anew after a failure, and when the process has to end."""

from __future__ import annotations

import ctypes
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest

from colony.runtime.assembly.processes.hosting import HostedParts
from colony.runtime.assembly.processes.restarts import MAX_QUICK_DEATHS
from colony.runtime.assembly.processes.shutdown import INTERVAL_S, QUIET_S, STALL_S, Stalls, reporting_stalls
from colony.runtime.assembly.processes.spec import ClockPart, DServerPart
from colony.runtime.protocol.messages import Node
from colony.runtime.store.store import StoreError
from colony.runtime.transport.live.robot_address import Local
from colony.runtime.transport.live.run_directory import RobotDirectory
from tests.waiting import until


class Stage:
    """Clock and DServer as the parts of a host, and what is told of them. Mutable: that."""

    def __init__(self, folder: Path) -> None:
        directory = RobotDirectory(folder / "rome", "rome")
        directory.prepare()
        self.told: list[str] = []
        self.failures: list[tuple[str, bool]] = []
        self.parts = HostedParts(
            Local(directory),
            None,
            self.told.append,
            on_failure=lambda part, reason, restarted: self.failures.append((reason, restarted)),
        )
        clock = ClockPart(servers=("DServer",), stop=str(folder / "stop"))
        self.nodes = self.parts.build((clock, DServerPart(store=str(folder / "store"))))

    def node(self, address: str) -> Node:
        return next(node for node in self.nodes if node.address == address)


@pytest.fixture
def stage(tmp_path: Path) -> Iterator[Stage]:
    made = Stage(tmp_path)
    with closing(made.parts):
        yield made
        for node in made.nodes:
            node.close()


@pytest.mark.parametrize(
    ("failed", "replaced"), [("DServer", ("DServer",)), ("Runtime", ("Clock", "Runtime"))]
)
def test_the_part_of_a_node_that_fails_starts_anew(
    stage: Stage, failed: str, replaced: tuple[str, ...]
) -> None:
    try:
        raise ArithmeticError("on purpose")
    except ArithmeticError as problem:
        replacement = stage.parts.replacement(failed, problem)
    assert (replacement.addresses, replacement.pause_ns) == (replaced, 0)
    for address in replaced:
        stage.node(address).close()
    made = replacement.make()
    stage.nodes = (*made, *(node for node in stage.nodes if node.address not in replaced))
    assert tuple(node.address for node in made) == replaced
    (text,) = stage.told
    assert text.startswith(f"{failed} failed; it is restarted\n")
    assert text.endswith("ArithmeticError: on purpose")
    assert stage.failures == [("ArithmeticError: on purpose", True)]


@pytest.mark.parametrize("problem", [StoreError("no disk"), MemoryError()])
def test_the_process_ends_where_a_new_node_would_not_help(stage: Stage, problem: Exception) -> None:
    with pytest.raises(type(problem)):
        stage.parts.replacement("DServer", problem)
    assert [restarted for _, restarted in stage.failures] == [False]


def test_the_process_ends_with_a_part_that_fails_again_and_again(stage: Stage) -> None:
    pauses = [
        stage.parts.replacement("Clock", ArithmeticError()).pause_ns for _ in range(MAX_QUICK_DEATHS - 1)
    ]
    assert pauses == sorted(pauses)
    with pytest.raises(ArithmeticError):
        stage.parts.replacement("Clock", ArithmeticError())


def test_code_that_keeps_the_interpreter_is_told_of() -> None:
    told: list[str] = []
    with reporting_stalls(told.append):
        ctypes.PyDLL(None).usleep(int((STALL_S + 3 * INTERVAL_S) * 1e6))  # keeps the interpreter
        until(lambda: told, "it is told of")
    assert told[0].startswith("this process stood still for ")


def test_of_the_stalls_of_a_busy_machine_only_longer_ones_are_told_of_soon() -> None:
    stalls = Stalls()
    waits = (
        (STALL_S / 2, 0.0),
        (0.5, 1.0),
        (0.4, 2.0),
        (0.6, 3.0),
        (0.5, 3.0 + QUIET_S),
        (0.4, 4.0 + QUIET_S),
    )
    told = [stalls.after(INTERVAL_S + late_s, now_s) is not None for late_s, now_s in waits]
    assert told == [False, True, False, True, True, False]
