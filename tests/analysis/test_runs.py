"""Runs of the runtime's own processes, in virtual time and under faults, agree with the reference."""

from __future__ import annotations

import random
from collections.abc import Callable
from dataclasses import replace

import pytest

from colony.analysis.audit import AuditReport, audit
from colony.ir.program import Program
from colony.runtime.assembly.virtual import VirtualSession
from colony.runtime.protocol.messages import Message, Request, Sample, ServerFrame
from tests.analysis.recorded_runs import MS, as_lines, as_mcap, read_lines, read_mcap
from tests.runtime.programs import drive, roam
from tests.runtime.scripted import FAR, Log, Script, session

S = 1000 * MS

DEGRADING = replace(roam(), robot=replace(roam().robot, actuators=(replace(drive(), on_loss="degrade"),)))


def script() -> Script:
    """Free way, now and then something ahead, bumps, and a sonar that fails for a while."""

    def sonar(t: int) -> Sample | None:
        if 3 * S <= t < 3500 * MS:
            return None
        return Sample((400.0 + t / 7e6 if t // S % 2 else 5000.0, *FAR[1:]), t)

    return Script(sonar_at=sonar, bumper_at=lambda t: t % (2 * S) < 150 * MS)


def audited(
    program: Program, faults: Callable[[VirtualSession], None] = lambda s: None, **options: object
) -> AuditReport:
    """A run of 6 s, audited as it was seen, and as it was recorded."""
    log = Log()
    whole = session(program, script(), log, requests=True, **options)
    faults(whole)
    assert whole.run(6 * S)
    report = audit(program, log.frames)
    assert report == audit(program, read_mcap(program, as_mcap(program, log.frames).content)[0])
    lines = audit(program, read_lines(program, as_lines(program, log.frames).content)[0])
    assert lines.agrees == report.agrees
    return report


def test_a_run_in_which_nothing_goes_wrong() -> None:
    report = audited(roam())
    assert report.first is None
    assert (report.frames, report.compared, report.idled, report.unheard) == (120, 120, 0, 0)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("program", [roam(), DEGRADING], ids=["stop", "degrade"])
def test_messages_late_lost_and_doubled(program: Program, seed: int) -> None:
    chance = random.Random(seed)

    def link(sender: str, receiver: str, message: Message) -> int | tuple[int, ...] | None:
        if receiver == "Observer" or not isinstance(message, (Request, ServerFrame)):
            return 0
        match chance.randrange(30):
            case 0:
                return None
            case 1:
                return (0, 0)
            case 2:
                return chance.randrange(100 * MS)
            case _:
                return 0

    report = audited(program, link=link)
    assert report.first is None
    assert report.late > 0
    assert report.compared > 100


@pytest.mark.parametrize("program", [roam(), DEGRADING], ids=["stop", "degrade"])
@pytest.mark.parametrize("client", ["drive/avoid", "drive/cruise", "drive/back_off"])
def test_a_client_that_dies(program: Program, client: str) -> None:
    report = audited(program, lambda s: s.transport.at(2 * S, lambda: s.kill(client)), isolate=True)
    assert report.first is None
    assert report.lost > 50


@pytest.mark.parametrize(
    "address", ["drive/avoid", "drive/cruise", "clients", "Clock", "RServer", "PServer", "DServer"]
)
def test_a_process_that_is_started_again(address: str) -> None:
    isolate = address.startswith("drive/")
    report = audited(roam(), lambda s: s.transport.at(2 * S, lambda: s.restart(address)), isolate=isolate)
    assert report.first is None
    assert report.frames > 100
    assert report.compared + report.unheard + report.unknown >= report.frames
    assert report.compared > 80


def test_an_observer_that_missed_frames() -> None:
    def deaf(sender: str, receiver: str, message: Message) -> int | None:
        away = receiver == "Observer" and isinstance(message, ServerFrame) and 40 <= message.k < 50
        return None if away else 0

    report = audited(roam(), link=deaf)
    assert report.first is None
    assert report.frames < 120
    assert 0 < report.unknown < report.frames
    assert report.compared >= 40
