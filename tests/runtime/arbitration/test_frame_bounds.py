"""Commands from outside are held to the bounds of their frame, and the program's own wait for none."""

from __future__ import annotations

import math
from dataclasses import replace

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from colony.execute.needs import BOUNDS
from colony.runtime.arbitration.arbiter import MAX_FRAMES_AHEAD, Arbiter, Dispatch
from colony.runtime.arbitration.ballot import NO_INTERVENTIONS, STOPPED, Interventions, OutsideCommand
from colony.runtime.protocol.deployment import ActuatorSpec
from colony.runtime.protocol.messages import Bounds, Verdict
from tests.runtime.arbitration.drive import DRIVE, MS, PLACES, TIMES, request, table, tick

NO_LIMITS = table(DRIVE, *PLACES)
LIMITED = msgspec.structs.replace(NO_LIMITS, limited=True)
FAST = OutsideCommand("ann/1", 9, (500.0, 40.0))
ALL_SILENT = tuple(request(client) for client in PLACES)


def bounds(k: int = 0, **changes: object) -> Bounds:
    fields: dict[str, object] = {"low": (-600.0, None), "high": (100.0, None)}
    return Bounds(k=k, actuator="drive", **(fields | changes))  # type: ignore[arg-type]


class Stage:
    """An arbiter, in whose frames ann commands unless told otherwise."""

    def __init__(self, spec: ActuatorSpec = LIMITED) -> None:
        self.arbiter = Arbiter(spec, TIMES)
        self.dispatches: list[Dispatch] = []
        self.verdicts: list[Verdict] = []

    def take(self, events: tuple[Dispatch | Verdict, ...]) -> None:
        self.dispatches += [e for e in events if isinstance(e, Dispatch)]
        self.verdicts += [e for e in events if isinstance(e, Verdict)]

    def open(self, k: int = 0, lost: frozenset[str] = frozenset(), *commands: OutsideCommand) -> None:
        others = Interventions(commands or (FAST,))
        self.take(self.arbiter.open(tick(k), lost, k * 50 * MS, others))

    def hear(self, *requests: object, at: int = 1 * MS) -> None:
        for one in requests:
            if isinstance(one, Bounds):
                self.take(self.arbiter.receive_bounds(one, at))
            else:
                self.take(self.arbiter.receive(one, at))  # type: ignore[arg-type]

    def wake(self, at: int) -> None:
        self.take(self.arbiter.wake(at))


@pytest.mark.parametrize("bounds_first", [True, False])
def test_a_command_is_held_to_the_bounds_of_its_frame(bounds_first: bool) -> None:
    stage = Stage()
    stage.open()
    stage.hear(*((bounds(), *ALL_SILENT) if bounds_first else (*ALL_SILENT, bounds())))
    (sent,) = stage.dispatches
    assert (sent.values, sent.fault, sent.outside) == ((100.0, 40.0), None, "ann/1")
    (verdict,) = stage.verdicts
    assert (verdict.values, verdict.notes, verdict.unlimited) == ((100.0, 40.0), (), False)


def test_both_bounds_of_each_field_hold() -> None:
    stage = Stage()
    stage.open(0, frozenset(), OutsideCommand("ann/1", 9, (-500.0, 40.0)))
    stage.hear(bounds(low=(-50.0, None), high=(600.0, 30.0)), *ALL_SILENT)
    assert stage.dispatches[0].values == (-50.0, 30.0)


def test_a_decision_waits_for_bounds_until_the_deadline_and_then_the_actuator_is_idle() -> None:
    stage = Stage()
    stage.open()
    stage.hear(*ALL_SILENT)
    assert stage.arbiter.wake_at == TIMES.deadline_ns
    stage.wake(TIMES.deadline_ns - 1)
    assert not stage.dispatches
    stage.wake(TIMES.deadline_ns)
    (sent,), (verdict,) = stage.dispatches, stage.verdicts
    assert (sent.values, sent.fault, sent.outside) == ((0.0, 0.0), "limits unknown", "ann/1")
    assert verdict.notes == ("limits of frame 0 have not come",)
    assert dict(verdict.fates)[BOUNDS] == "late"
    stage.hear(bounds(), at=TIMES.deadline_ns + 1)
    assert len(stage.dispatches) == 1


def test_the_grace_after_a_command_of_the_network_does_not_cut_the_wait_short() -> None:
    stage = Stage()
    stage.open()
    stage.hear(request("cruise", "command"))
    stage.wake(TIMES.grace_ns + 1 * MS)
    assert not stage.dispatches
    assert stage.arbiter.wake_at == TIMES.deadline_ns
    stage.hear(bounds(), at=20 * MS)
    assert stage.dispatches[0].values == (100.0, 40.0)


def test_the_decision_of_the_network_waits_for_no_bounds() -> None:
    stage = Stage()
    stage.take(stage.arbiter.open(tick(0), frozenset(), 0, NO_INTERVENTIONS))
    stage.hear(request("back_off", "command"))
    assert stage.dispatches[0].by == "back_off"
    below = Stage()
    below.open(0, frozenset(), OutsideCommand("ann/1", 0, (500.0, 0.0)))
    below.hear(request("back_off", "command"))
    assert below.dispatches[0].by == "back_off"


@pytest.mark.parametrize("fault", ["limits contradict", "bound missing"])
def test_where_no_command_is_allowed_the_actuator_is_idle(fault: str) -> None:
    stage = Stage()
    stage.open()
    stage.hear(bounds(low=(), high=(), fault=fault), *ALL_SILENT)
    assert (stage.dispatches[0].values, stage.dispatches[0].fault) == ((0.0, 0.0), fault)
    assert stage.verdicts[0].notes == (f"limits of frame 0: {fault}",)
    assert BOUNDS not in dict(stage.verdicts[0].fates)


def test_a_lost_client_of_bounds_is_not_waited_for() -> None:
    stage = Stage()
    stage.open(0, frozenset({BOUNDS}))
    stage.hear(*ALL_SILENT)
    assert stage.dispatches[0].fault == "limits unknown"
    assert stage.verdicts[0].notes == ("limits of frame 0 are not known: `.bounds` is lost",)


def test_limits_that_tighten_hold_from_their_frame_on() -> None:
    stage = Stage()
    for k, most in enumerate((600.0, 200.0, 0.0, -50.0)):
        stage.open(k)
        stage.hear(bounds(k, high=(most, None)), at=k * 50 * MS)
        stage.hear(*(msgspec.structs.replace(r, k=k) for r in ALL_SILENT), at=k * 50 * MS)
    assert [d.values for d in stage.dispatches] == [
        (500.0, 40.0),
        (200.0, 40.0),
        (0.0, 40.0),
        (-50.0, 40.0),
    ]


def test_bounds_of_other_frames_do_not_count() -> None:
    stage = Stage()
    stage.hear(bounds(1))
    stage.open(1)
    stage.hear(bounds(0, high=(5.0, None)), bounds(2, high=(7.0, None)), at=51 * MS)
    stage.hear(*(msgspec.structs.replace(r, k=1) for r in ALL_SILENT), at=51 * MS)
    stage.open(2)
    stage.hear(*(msgspec.structs.replace(r, k=2) for r in ALL_SILENT), at=101 * MS)
    assert [d.values for d in stage.dispatches] == [(100.0, 40.0), (7.0, 40.0)]


def test_the_first_bounds_of_a_frame_count() -> None:
    stage = Stage()
    stage.open()
    stage.hear(bounds(), bounds(high=(600.0, None)), *ALL_SILENT)
    assert stage.dispatches[0].values == (100.0, 40.0)


def test_not_many_bounds_are_kept_before_their_ticks() -> None:
    for first in (-1, 0):
        stage = Stage()
        if first == 0:
            stage.open()
        stage.hear(*(bounds(k) for k in range(1, 5 * MAX_FRAMES_AHEAD)))
        assert len(stage.arbiter._bounds._ahead) <= MAX_FRAMES_AHEAD


@pytest.mark.parametrize(
    ("wrong", "note"),
    [
        ({"low": (0.0,)}, "bounds of drive: 1 lower and 2 upper ones; expected 2 of each"),
        ({"high": ()}, "bounds of drive: 2 lower and 0 upper ones; expected 2 of each"),
        ({"high": (math.nan, None)}, "bounds of drive: velocity from -600.0 to nan"),
        ({"low": (-math.inf, None)}, "bounds of drive: velocity from -inf to 100.0"),
        ({"low": (200.0, None)}, "bounds of drive: velocity from 200.0 to 100.0"),
        ({"high": (700.0, None)}, "bounds of drive: velocity from -600.0 to 700.0"),
        ({"low": (None, None)}, "bounds of drive: velocity from None to 100.0"),
    ],
)
def test_malformed_bounds_move_nothing(wrong: dict[str, object], note: str) -> None:
    stage = Stage()
    stage.open()
    stage.hear(bounds(**wrong), *ALL_SILENT)
    assert stage.dispatches[0].values == (0.0, 0.0)
    assert stage.verdicts[0].notes[0] == note
    assert dict(stage.verdicts[0].fates)[BOUNDS] == "refused"


@pytest.mark.parametrize("spec", [NO_LIMITS, LIMITED])
def test_without_limits_and_with_the_right_to_ignore_them_nothing_is_waited_for(spec: ActuatorSpec) -> None:
    stage = Stage(spec)
    stage.open(0, frozenset(), FAST._replace(unlimited=spec.limited))
    stage.hear(bounds(), *ALL_SILENT)
    assert stage.dispatches[0].values == FAST.values
    assert stage.verdicts[0].unlimited is spec.limited


def test_the_holder_of_the_lock_obeys_too_and_a_stop_waits_for_nothing() -> None:
    locked = Stage()
    locked.take(locked.arbiter.open(tick(0), frozenset(), 0, Interventions((FAST,), "locked", "ann/1")))
    assert not locked.dispatches
    locked.hear(bounds())
    assert (locked.dispatches[0].values, locked.dispatches[0].hold) == ((100.0, 40.0), "locked")
    stopped = Stage()
    stopped.open()
    stopped.take(stopped.arbiter.intervene(STOPPED, 1 * MS))
    assert (stopped.dispatches[0].values, stopped.dispatches[0].fault) == ((0.0, 0.0), None)


def test_on_idle_hold_nothing_is_sent() -> None:
    hold = msgspec.structs.replace(table(replace(DRIVE, idle=None), *PLACES), limited=True)
    stage = Stage(hold)
    stage.open()
    stage.hear(*ALL_SILENT)
    stage.wake(TIMES.deadline_ns)
    assert (stage.dispatches[0].values, stage.dispatches[0].fault) == (None, "limits unknown")


finite = st.floats(-600.0, 600.0)


@given(finite, finite, finite, st.booleans(), st.booleans())
def test_nothing_beyond_the_bounds_is_ever_sent(
    velocity: float, one: float, other: float, late: bool, unlimited: bool
) -> None:
    low, high = sorted((one, other))
    stage = Stage()
    stage.open(0, frozenset(), OutsideCommand("ann/1", 9, (velocity, 0.0), unlimited=unlimited))
    if not late:
        stage.hear(bounds(low=(low, None), high=(high, None)))
    stage.hear(*ALL_SILENT)
    stage.wake(TIMES.deadline_ns)
    (sent,) = stage.dispatches
    assert sent.values is not None
    if unlimited:
        assert sent.values[0] == velocity
    elif late:
        assert sent.values == (0.0, 0.0)
    else:
        assert sent.values[0] == min(max(velocity, low), high)
