"""A shadow beside another controller: the program decides as ever, and contracts see what was commanded."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import replace

import pytest

from colony.analysis.audit import audit
from colony.compile.pipeline import compile_program
from colony.runtime.assembly.controller import Controller
from colony.runtime.assembly.shadow import Shadow
from colony.runtime.frames.run_frame import HeardCommand, RunFrame
from colony.runtime.protocol.bindings import bind
from colony.runtime.protocol.deployment import deployment
from colony.runtime.protocol.messages import Sample, ServerFrame, Tick
from colony.runtime.recordings.lines import Recording
from colony.runtime.recordings.mcap_writer import McapRecording
from colony.runtime.recordings.opening import read_recording
from tests.analysis.recorded_runs import Kept, run_info, written
from tests.kit.node_stage import MS
from tests.robot_servers import ROME_SERVERS
from tests.runtime.assembly.shadow_stage import RAMP, READINGS, program
from tests.runtime.scripted import Log

TEXT = f"""{RAMP}
contract gentle: drive.velocity <= value_or(last.drive.velocity, 0 mm/s) + 50 mm/s
contract patient: drive.velocity > 100 mm/s implies sustained(drive.velocity > 0 mm/s, 100 ms)
"""


class Beside:
    """A shadow, and what the robot's servers publish. Mutable: its frames."""

    def __init__(self, text: str = TEXT, unjudged: Sequence[str] = ()) -> None:
        self.program, self._log, self._k = program(text), Log(), 0
        self.compiled = compile_program(self.program).compiled
        bindings = bind(self.compiled.robot, ROME_SERVERS)
        deployed = deployment(self.compiled, bindings, run="shadow", seed=0)
        controller = Controller(self.compiled, bindings.actuators, unjudged)
        self._shadow = Shadow(self.compiled, bindings, deployed, (self._log,), controller)

    def frames(self, commands: Sequence[float | None], *, skipped: int = 0) -> list[RunFrame]:
        """Let the controller command these velocities, or nothing; return all frames so far."""
        self._k += skipped
        for velocity in commands:
            t_ns = self._k * 50 * MS
            self._shadow.handle(Tick(k=self._k, t_ns=t_ns, run="r"), t_ns)
            for server, readings in READINGS.items():
                fields: dict[str, Sample | None] = {n: Sample(v, t_ns) for n, v in readings.items()}  # type: ignore[arg-type]
                if server == "RServer" and velocity is not None:
                    fields["heard.drive"] = Sample((velocity, 5.0), t_ns - 7 * MS)
                self._shadow.handle(ServerFrame(server=server, k=self._k, fields=fields), t_ns)
            self._k += 1
        return self._log.frames


def test_the_program_decides_as_it_does_alone() -> None:
    found, alone = Beside().frames([100.0, None, 250.0] * 4), Beside().frames([None] * 12)
    assert [log.verdicts for log in found] == [log.verdicts for log in alone]
    assert [log.frame for log in found] == [log.frame for log in alone]
    assert audit(program(TEXT), found).agrees


def test_frames_have_the_commands_with_their_age() -> None:
    found = Beside().frames([100.0, None])
    assert [log.heard for log in found] == [{"drive": HeardCommand((100.0, 5.0), 7 * MS)}, {"drive": None}]


def test_contracts_see_the_commands_and_remember_them() -> None:
    found = Beside().frames([40.0, 90.0, 150.0, 400.0, None, 120.0, 60.0])
    assert [log.heard_breaches for log in found] == [
        (),
        (),
        ("gentle",),
        ("slow", "gentle"),
        (),
        ("gentle", "patient"),  # it stood in the frame before
        (),
    ]
    assert not any(log.expected.breaches for log in found)


def test_contracts_that_cannot_judge_are_left_out() -> None:
    commands = [40.0, 400.0, None, 120.0]
    found, fewer = Beside().frames(commands), Beside(unjudged=("gentle",)).frames(commands)
    assert [log.heard_breaches for log in found] == [
        (),
        ("slow", "gentle", "patient"),
        (),
        ("gentle", "patient"),
    ]
    assert [log.heard_breaches for log in fewer] == [(), ("slow", "patient"), (), ("patient",)]


def test_another_controller_breaks_no_assumption() -> None:
    beside = Beside(f"{TEXT}assume fast: last.drive.velocity > 1 m/s\n")
    found = beside.frames([40.0, 400.0])
    assert all("fast" in log.expected.breaches for log in found)
    assert [log.heard_breaches for log in found] == [(), ("slow", "gentle", "patient")]


def test_their_memory_restarts_with_that_of_the_program() -> None:
    beside = Beside()
    beside.frames([50.0, 100.0, 150.0])
    found = beside.frames([170.0], skipped=3)
    assert found[-1].restart
    assert found[-1].heard_breaches == ("gentle", "patient")


@pytest.mark.parametrize("is_mcap", [True, False])
def test_a_recording_has_the_commands_and_what_they_broke(is_mcap: bool) -> None:
    beside, file = Beside(), Kept()
    frames = beside.frames([100.0, None, 400.0, 120.0])
    if is_mcap:
        info = replace(run_info(beside.program), shadow=True, heard=("drive",))
        written(McapRecording(beside.compiled, info, file), frames)
    else:
        written(Recording(beside.compiled, file, shadow=True), frames)
    read = list(read_recording(io.BytesIO(file.content), "run").frames(beside.program))
    assert [log.heard for log in read] == [log.heard for log in frames]
    assert [log.heard_breaches for log in read] == [log.heard_breaches for log in frames]
    assert [log.verdicts["drive"].values for log in read] == [log.verdicts["drive"].values for log in frames]


def test_a_recording_without_another_controller_says_nothing_of_one() -> None:
    beside, file = Beside(), Kept()
    frames = [replace(log, heard={}, heard_breaches=()) for log in beside.frames([100.0, 400.0])]
    written(Recording(beside.compiled, file), frames)
    assert b"heard" not in file.content
    mcap = Kept()
    written(McapRecording(beside.compiled, run_info(beside.program), mcap), frames)
    assert not any(log.heard for log in read_recording(io.BytesIO(mcap.content), "r").frames(beside.program))
