"""The verdict on a robot: what passes, and each injected failure, which fails it by itself."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace

import pytest

from colony.analysis.report import AuditReport, ContractCount, DamagedSpan, Difference
from colony.cli.robot.acceptance.findings import (
    BRAKE_NS,
    STOP_NS,
    AcceptanceFindings,
    Census,
    FaultFinding,
    Incarnations,
    StopFinding,
)

MS = 1_000_000
SECOND = 1000 * MS
BEGIN_NS = 5 * SECOND
MB = 1 << 20

AUDIT = AuditReport(
    frames=1200,
    first_ns=BEGIN_NS,
    last_ns=BEGIN_NS + 60 * SECOND,
    compared=1000,
    idled=12,
    unheard=20,
    late=3,
    lost=2,
    refused=0,
    violations=0,
    outside=0,
    holds=170,
    restarts=0,
    unknown=10,
    differing=0,
    first=None,
    contracts=(),
)
STOP = StopFinding(
    at_ns=BEGIN_NS + 2 * SECOND, acknowledged=("Clock", "RServer"), stopped_ns=95 * MS, resumed_ns=60 * MS
)
KILL = FaultFinding(
    kind="kill", at_ns=BEGIN_NS + 4 * SECOND, processes=("RServer",), back_ns=1300 * MS, braked_ns=40 * MS
)
FREEZE = FaultFinding(
    kind="freeze", at_ns=BEGIN_NS + 6 * SECOND, processes=("Clock", "clients"), back_ns=85 * MS
)


def findings(census: Census | None = None) -> AcceptanceFindings:
    return AcceptanceFindings(
        robot="amr",
        actuators=1,
        stops=[STOP],
        faults=[KILL, FREEZE],
        memory=census or census_of([34] * 60),
        audit=AUDIT,
        seconds=60.0,
        driven_mm=4200.0,
    )


def census_of(curve: list[int]) -> Census:
    census, process = Census(), Incarnations()
    process.curves = [[size * MB for size in curve]]
    census.processes = {"DServer": process}
    return census


def test_a_robot_that_passes_has_a_table_without_failures() -> None:
    found = findings()
    assert found.failures() == []
    assert list(found.lines()) == [
        "stops        1 of 1 acknowledged and held, at most 95 ms",
        "kills        1 of 1 came back, at most 1.3 s (RServer); the base braked within 40 ms",
        "freezes      1 of 1 came back, at most 85 ms (Clock, clients)",
        "decisions    1,000 of 1,200 as the interpreter decides, 12 of them idle for want of a client; "
        "not compared: 170 while stopped, 20 without a verdict, 10 after a frame that was not observed",
        "distance     4.2 m",
        "memory       at most 34 MB a process, not growing",
    ]
    assert json.loads(json.dumps(found.as_json()))["passes"] is True


Change = Callable[[AcceptanceFindings], object]


def stop(**changes: object) -> Change:
    return lambda found: found.stops.append(replace(STOP, **changes))  # type: ignore[arg-type]


def fault(kind: FaultFinding, **changes: object) -> Change:
    return lambda found: found.faults.append(replace(kind, **changes))  # type: ignore[arg-type]


def audited(**changes: object) -> Change:
    return lambda found: setattr(found, "audit", replace(AUDIT, **changes))  # type: ignore[arg-type]


DIFFERENCE = Difference(index=40, k=40, t_ns=BEGIN_NS + SECOND, actuator="drive", message="by avoid")
BREACH = ContractCount(contract="stops_ahead", frames=3, first_ns=BEGIN_NS + 9 * SECOND, last_ns=BEGIN_NS)

INJECTED: dict[str, Change] = {
    "at 2.00 s: emergency stop: RServer did not acknowledge the stop": stop(
        problems=("RServer did not acknowledge the stop",)
    ),
    "at 2.00 s: emergency stop: not every actuator was held": stop(stopped_ns=None, resumed_ns=None),
    "at 2.00 s: emergency stop: held only after 501 ms": stop(stopped_ns=STOP_NS + MS),
    "at 3.50 s: emergency stop: not held: drive by cruise": stop(
        slip=(BEGIN_NS + 3500 * MS, "drive by cruise")
    ),
    "at 2.00 s: no decision within 20.0 s of the release of an emergency stop": stop(resumed_ns=None),
    "at 4.00 s: RServer killed: not recovered within 20.0 s: RServer is down": fault(
        KILL, back_ns=None, missing=("RServer is down",)
    ),
    "at 4.00 s: RServer killed: the base did not brake for 1.5 s": fault(
        KILL, braked_ns=BRAKE_NS + SECOND // 2
    ),
    "at 6.00 s: Clock and clients frozen: not recovered within 20.0 s": fault(FREEZE, back_ns=None),
    "at 7.00 s: Lidar died by itself": lambda found: found.losses.append(
        (BEGIN_NS + 7 * SECOND, "Lidar died by itself")
    ),
    "the run did not end": lambda found: found.losses.append((None, "the run did not end")),
    "the leader: at 3 s, drive differs": lambda found: setattr(
        found, "disagreements", ("at 3 s, drive differs",)
    ),
    "at 1.00 s: the interpreter decides differently: by avoid": audited(first=DIFFERENCE, differing=1),
    "at 9.00 s: contract stops_ahead broken in 3 frames": audited(contracts=(BREACH,)),
    "the recording is damaged": audited(damaged=(DamagedSpan(after_ns=1, before_ns=2),)),
    "only 5 decisions could be compared": audited(compared=5, unknown=900),
    "there is no recording to audit": lambda found: setattr(found, "audit", None),
    "DServer grew by 10.0 MB in a life of 60 s": lambda found: setattr(
        found, "memory", census_of([50] * 30 + [60] * 30)
    ),
}


@pytest.mark.parametrize("text", INJECTED)
def test_each_injected_failure_fails_the_robot_and_has_its_second_of_the_recording(text: str) -> None:
    found = findings(census_of([50] * 60))
    INJECTED[text](found)
    reasons = [str(failure) for failure in found.failures()]
    assert reasons == [text]
    assert found.as_json()["passes"] is False


def test_failures_are_in_the_order_of_the_recording() -> None:
    found = findings()
    for text in ("at 6.00 s: Clock and clients frozen: not recovered within 20.0 s", "the run did not end"):
        INJECTED[text](found)
    INJECTED["at 2.00 s: emergency stop: held only after 501 ms"](found)
    assert [failure.at_s for failure in found.failures()] == [2.0, 6.0, None]


def test_without_a_recording_no_failure_has_a_second_of_it() -> None:
    found = findings()
    found.audit = None
    found.losses.append((BEGIN_NS, "Lidar died by itself"))
    assert [str(reason) for reason in found.failures()] == [
        "Lidar died by itself",
        "there is no recording to audit",
    ]


def test_a_test_that_is_interrupted_before_the_first_frame_has_found_nothing() -> None:
    found = AcceptanceFindings(robot="amr", actuators=1, interrupted=True)
    assert found.failures() == []
    assert next(iter(found.lines())) == "stops        0 of 0 acknowledged and held"
