"""The summary counts what happened, as data and in words."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace

from msgspec import structs

from colony.compile.pipeline import compile_program
from colony.execute.needs import BOUNDS
from colony.ir.expression import SensorValue
from colony.ir.program import Limit, Module, Program, TransferFunction, Use, Wire
from colony.ir.types import BOOL
from colony.runtime.frames.run_frame import RunFrame
from colony.runtime.observe.summary import RunSummary, Tally, Travel, render
from colony.runtime.protocol.messages import Hold, Message, Request, Sample
from colony.runtime.transport.exchange import Link, deliver_immediately
from tests.kit.node_stage import MS, S
from tests.runtime.programs import go, number, roam
from tests.runtime.scripted import FAR, Log, Script, session


def summarize(
    program: Program, script: Script, duration_ns: int = 4 * S, link: Link = deliver_immediately
) -> RunSummary:
    tally = Tally(compile_program(program).compiled)
    session(program, script, tally, link=link).run(duration_ns)
    return tally.summary(
        seed=1, duration_s=duration_ns / 1e9, interrupted=False, travel=Travel(bumps=1, distance_mm=1200.0)
    )


def tallied(program: Program, change: Callable[[RunFrame], RunFrame], duration_ns: int = 1 * S) -> RunSummary:
    """The summary of a run whose frames were changed before they were counted."""
    tally = Tally(compile_program(program).compiled)

    class Changing(Log):
        def take(self, log: RunFrame) -> None:
            tally.take(change(log))

    session(program, Script(), Changing()).run(duration_ns)
    return tally.summary(seed=0, duration_s=duration_ns / 1e9, interrupted=False, travel=None)


def awake() -> Program:
    """roam whose contract does not hold, without chance."""
    program = roam()
    wires = (Wire(name="drive", actuator="drive", wiring=Use(name="cruise")),)
    return replace(program, wires=wires)


def cruise(program: Program) -> Module:
    return program.modules[0]


def test_a_broken_assumption_is_no_failure() -> None:
    program = awake()
    contracts = tuple(replace(c, assumed=True) for c in program.contracts)
    summary = summarize(
        replace(program, contracts=contracts), Script(bumper_at=lambda t: t in (1 * S, 2 * S))
    )
    assert [(b.contract, b.assumed) for b in summary.breaches] == [("never_ram", True)]
    assert summary.contracts == 0
    assert summary.succeeded
    assert "assumption never_ram: broken in 2 frames, first at 1 s, last at 2 s" in render(summary)
    assert "BROKEN" not in render(summary)


def test_shares_and_breaches() -> None:
    summary = summarize(awake(), Script(bumper_at=lambda t: t in (1 * S, 2 * S)))
    (drive,) = summary.actuators
    assert [(s.module, s.frames, s.seconds, s.percent) for s in drive.shares] == [
        ("cruise", 80, 4.0, 100.0),
        (None, 0, 0.0, 0.0),
    ]
    (breach,) = summary.breaches
    assert (breach.contract, breach.frames, breach.first_s, breach.last_s) == ("never_ram", 2, 1.0, 2.0)
    assert not summary.succeeded
    text = render(summary)
    assert "rome: 4.0 s, 80 frames, seed 1" in text
    assert "traveled 1.20 m at 300 mm/s on average, 1 bump\n" in text
    assert "contract never_ram: BROKEN in 2 frames, first at 1 s, last at 2 s" in text
    assert json.loads(json.dumps(summary.as_json()))["breaches"][0]["frames"] == 2


def test_records_of_limits_and_faults() -> None:
    bumper = SensorValue(type=BOOL, name="bumper")
    program = awake()
    fast = replace(cruise(program), command=go(900.0, 0.0))
    limited = replace(
        program,
        modules=(fast, *program.modules[1:]),
        limits=(Limit(actuator="drive", field_index=0, relation="<=", bound=number(0.0), condition=bumper),),
    )
    summary = summarize(
        limited,
        Script(
            bumper_at=lambda t: t < 500 * MS,
            sonar_at=lambda t: Sample((20_000.0, *FAR[1:]) if t == 1 * S else FAR, t),
        ),
    )
    assert {(r.kind, r.subject): r.frames for r in summary.records} == {
        ("limited", "drive.velocity"): 10,
        ("command clamped", "drive.velocity"): 70,
        ("sensor clamped", "sonar"): 1,
    }
    assert summary.succeeded
    assert "drive.velocity: limited in 10 frames" in render(summary)
    assert "1 contract held in every frame" in render(summary)


def test_troubles() -> None:
    def slow(sender: str, receiver: str, message: Message) -> int | None:
        return 45 * MS if isinstance(message, Request) and message.k in (3, 4) else 0

    summary = summarize(awake(), Script(), link=slow)
    assert [(t.client, t.fate, t.frames) for t in summary.troubles] == [("cruise", "late", 2)]
    assert "client cruise: late in 2 frames" in render(summary)
    assert summary.actuators[0].shares[-1].frames == 2


def test_the_client_of_bounds_is_named_by_its_address() -> None:
    def marked(log: RunFrame) -> RunFrame:
        fates = (*log.verdicts["drive"].fates, (BOUNDS, "late"))
        verdict = structs.replace(log.verdicts["drive"], fates=fates, outside="joystick")
        return replace(log, verdicts={"drive": verdict})

    assert "client drive/.bounds: late in 2 frames" in render(tallied(awake(), marked, 100 * MS))


def test_a_server_without_verdicts_is_named() -> None:
    def deaf(log: RunFrame) -> RunFrame:
        return replace(log, verdicts={} if log.tick.k % 4 == 0 else log.verdicts)

    summary = tallied(awake(), deaf, 4 * S)
    (drive,) = summary.actuators
    assert (drive.unheard.server, drive.unheard.frames, drive.unheard.percent) == ("RServer", 20, 25.0)
    assert sum(share.frames for share in drive.shares) + drive.unheard.frames == summary.frames
    assert "    cruise                      3.00 s   75.0 %\n" in render(summary)
    assert "    (no verdict of RServer)     1.00 s   25.0 %\n" in render(summary)
    assert summarize(awake(), Script()).actuators[0].unheard is None


def test_a_command_that_is_not_finite_is_a_fault() -> None:
    program = awake()
    bad = replace(
        cruise(program),
        command=TransferFunction(actuator="drive", fields=(number(float("nan")), number(0.0))),
    )
    summary = summarize(replace(program, modules=(bad, *program.modules[1:])), Script(), 1 * S)
    assert [(r.kind, r.subject, r.frames) for r in summary.records] == [("not finite", "cruise", 20)]
    assert summary.actuators[0].shares[0].frames == 20


def test_no_frames() -> None:
    tally = Tally(compile_program(roam()).compiled)
    summary = tally.summary(seed=0, duration_s=0.0, interrupted=True, travel=Travel(bumps=0, distance_mm=0.0))
    assert "0 frames, seed 0, interrupted" in render(summary)
    assert "held in every frame" not in render(summary)


def test_what_kept_the_network_from_deciding() -> None:
    marks: dict[int, tuple[str | None, Hold | None]] = {
        0: ("joystick", None),
        1: ("joystick", None),
        2: (None, "stopped"),
        3: (None, "locked"),
        4: ("inspector", "locked"),
    }

    def marked(log: RunFrame) -> RunFrame:
        k = log.tick.k
        outside, hold = marks.get(k, (None, None))
        verdict = structs.replace(log.verdicts["drive"], outside=outside, hold=hold, unlimited=k == 1)
        return replace(log, verdicts={"drive": verdict}, skipped=3 * (k == 5), restart=k == 6)

    summary = tallied(awake(), marked)
    assert [(i.by, i.hold, i.frames, i.unlimited) for i in summary.interventions] == [
        ("joystick", None, 2, 1),
        (None, "stopped", 1, 0),
        (None, "locked", 1, 0),
        ("inspector", "locked", 1, 0),
    ]
    told = render(summary)
    assert (
        "drive: joystick commanded from outside the network in 2 frames (1 of them ignored the limits)\n"
        in told
    )
    assert "drive: the EMERGENCY STOP was on (`colony stop --release` ends it) in 1 frame" in told
    assert "drive: a connection outside the network held the lock in 1 frame\n" in told
    assert "all memory restarted 1 time\n  3 frames could not be observed" in told
    assert "drive: inspector, which holds the lock, commanded in 1 frame" in told
    assert summary.succeeded


def test_drivers_that_failed_are_named() -> None:
    tally = Tally(compile_program(roam()).compiled)
    summary = tally.summary(seed=0, duration_s=0.0, interrupted=False, travel=None)
    failed = replace(summary, driver_failures=("Lidar failed: \x1b[31mno bus",))
    assert render(failed).splitlines()[-1] == r"  Lidar failed: \x1b[31mno bus"
    assert failed.as_json()["driver_failures"] == failed.driver_failures
