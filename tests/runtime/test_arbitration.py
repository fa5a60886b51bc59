"""Arbitration as tables: what comes in, what is dispatched, and what the verdict says of everybody."""

from __future__ import annotations

import itertools

import pytest

from colony.ir.program import Actuator, ActuatorField
from colony.ir.types import BOOL
from colony.runtime.arbitration import AHEAD, Arbiter, Dispatch, Timing, choose, malformed
from colony.runtime.fields import SPEED
from colony.runtime.messages import Request, Tick, Verdict

MS = 1_000_000
TIMES = Timing(deadline_ns=40 * MS, grace_ns=5 * MS)
PLACES = ("back_off", "avoid", "cruise")
DRIVE = Actuator(
    name="drive",
    fields=(
        ActuatorField(name="velocity", type=SPEED, low=-600.0, high=600.0),
        ActuatorField(name="turn", type=SPEED),
    ),
    server="RServer",
    command="drive",
    idle=(0.0, 0.0),
)
COMMANDS = {"back_off": (-200.0, 15.0), "avoid": (80.0, 30.0), "cruise": (300.0, 0.0)}


def request(client: str, bid: str = "silent", k: int = 0) -> Request:
    values = COMMANDS.get(client, (1.0, 1.0)) if bid == "command" else None
    return Request(k=k, actuator="drive", client=client, bid=bid, values=values)  # type: ignore[arg-type]


def arbiter() -> Arbiter:
    return Arbiter(DRIVE, PLACES, TIMES)


def tick(k: int = 0) -> Tick:
    return Tick(k=k, t_ns=k * 50 * MS)


def run(*bids: tuple[str, str], lost: tuple[str, ...] = ()) -> tuple[list[Dispatch], list[Verdict]]:
    """One frame with these requests in this order, and the next tick after it."""
    one = arbiter()
    events = [*one.open(tick(0), frozenset(lost), 0)]
    for client, bid in bids:
        events += one.receive(request(client, bid), 1 * MS)
    events += one.wake(40 * MS)
    events += one.open(tick(1), frozenset(), 50 * MS)
    dispatches = [e for e in events if isinstance(e, Dispatch)]
    return dispatches, [e for e in events if isinstance(e, Verdict)]


TABLE = [
    # requests, lost, winner, fates of back_off avoid cruise
    ("all silent", "sss", "", None, "silent silent silent"),
    ("the lowest alone", "ssc", "", "cruise", "silent silent won"),
    ("the highest alone", "css", "", "back_off", "won silent silent"),
    ("suppressed is not silent", "chh", "", "back_off", "won suppressed suppressed"),
    ("a late client, nobody else", "-ss", "", None, "late silent silent"),
    ("a late higher client does not undo an exclusive command", "-sc", "", "cruise", "late silent won"),
    ("a late lower client", "sc-", "", "avoid", "silent won late"),
    ("all late", "---", "", None, "late late late"),
    ("a lost client is not waited for", "-ss", "back_off", None, "lost silent silent"),
    ("a lost client's command does not count", "css", "back_off", None, "lost silent silent"),
    ("all lost", "---", "back_off avoid cruise", None, "lost lost lost"),
]


@pytest.mark.parametrize(
    ("bids", "lost", "winner", "fates"), [row[1:] for row in TABLE], ids=[r[0] for r in TABLE]
)
def test_frames(bids: str, lost: str, winner: str | None, fates: str) -> None:
    names = {"s": "silent", "c": "command", "h": "suppressed"}
    came = [(c, names[b]) for c, b in zip(PLACES, bids, strict=True) if b != "-"]
    for order in itertools.permutations(came):
        dispatches, verdicts = run(*order, lost=tuple(lost.split()))
        assert [d.by for d in dispatches] == [winner]
        assert dispatches[0].values == (COMMANDS[winner] if winner else (0.0, 0.0))
        (verdict,) = verdicts
        assert verdict.by == winner
        assert [f.replace(" ", "-") for _, f in verdict.fates] == fates.split()
        assert not verdict.violation


@pytest.mark.parametrize("order", list(itertools.permutations(PLACES)))
def test_of_two_commands_one_goes_out_and_it_is_the_higher_in_any_order(order: tuple[str, ...]) -> None:
    bids = {"back_off": "silent", "avoid": "command", "cruise": "command"}
    dispatches, (verdict,) = run(*((c, bids[c]) for c in order))
    assert [d.values for d in dispatches] == [COMMANDS["avoid"]]
    assert verdict.violation
    assert dict(verdict.fates) == {"back_off": "silent", "avoid": "won", "cruise": "overruled"}


def test_the_command_goes_out_as_soon_as_nobody_higher_is_missing() -> None:
    one = arbiter()
    one.open(tick(), frozenset(), 0)
    assert one.receive(request("back_off"), MS) == ()
    assert one.receive(request("avoid", "command"), MS) == (Dispatch(0, "avoid", (80.0, 30.0), None),)
    (verdict,) = one.receive(request("cruise"), 2 * MS)
    assert isinstance(verdict, Verdict)
    assert one.wake_at is None


def test_a_silent_higher_client_delays_a_command_by_the_grace_at_most() -> None:
    one = arbiter()
    one.open(tick(), frozenset(), 0)
    assert one.wake_at == 40 * MS
    assert one.receive(request("cruise", "command"), 2 * MS) == ()
    assert one.wake_at == 7 * MS
    assert one.wake(7 * MS - 1) == ()
    (dispatch,) = one.wake(7 * MS)
    assert isinstance(dispatch, Dispatch)
    assert dispatch.by == "cruise"


def test_idle_at_the_deadline_and_what_comes_later_is_late() -> None:
    one = arbiter()
    one.open(tick(), frozenset(), 0)
    one.receive(request("avoid"), MS)
    one.receive(request("cruise"), MS)
    assert one.wake(40 * MS) == (Dispatch(0, None, (0.0, 0.0), None),)
    (verdict,) = one.receive(request("back_off", "command"), 41 * MS)
    assert isinstance(verdict, Verdict)
    assert verdict.by is None
    assert dict(verdict.fates)["back_off"] == "late"
    assert verdict.notes == ("`back_off` commanded after the deadline",)


def test_requests_may_come_before_their_tick_and_twice() -> None:
    one = arbiter()
    for client in PLACES:
        assert one.receive(request(client, "command" if client == "cruise" else "silent"), 0) == ()
    dispatch, verdict = one.open(tick(), frozenset(), MS)
    assert isinstance(dispatch, Dispatch)
    assert dispatch.by == "cruise"
    assert isinstance(verdict, Verdict)
    assert one.receive(request("back_off", "command"), 2 * MS) == ()


def test_requests_of_other_frames_change_nothing() -> None:
    one = arbiter()
    one.open(tick(5), frozenset(), 250 * MS)
    assert one.receive(request("back_off", "command", k=4), 251 * MS) == ()
    assert one.receive(request("back_off", "command", k=6 + AHEAD), 251 * MS) == ()
    assert one.open(tick(5), frozenset(), 251 * MS) == ()
    assert one.open(tick(4), frozenset(), 251 * MS) == ()


def test_a_frame_without_a_wake_ends_with_the_next_tick() -> None:
    one = arbiter()
    one.open(tick(0), frozenset(), 0)
    dispatch, verdict = one.open(tick(1), frozenset(), 50 * MS)
    assert dispatch == Dispatch(0, None, (0.0, 0.0), None)
    assert isinstance(verdict, Verdict)
    assert verdict.k == 0
    assert one.finish()[0] == Dispatch(1, None, (0.0, 0.0), None)
    assert one.finish() == ()


def test_a_command_that_is_not_finite_wins_and_sends_the_idle_command() -> None:
    one = Arbiter(DRIVE, ("cruise",), TIMES)
    one.open(tick(), frozenset(), 0)
    bad = Request(k=0, actuator="drive", client="cruise", bid="command", fault="not finite")
    dispatch, verdict = one.receive(bad, MS)
    assert dispatch == Dispatch(0, "cruise", (0.0, 0.0), "not finite")
    assert isinstance(verdict, Verdict)
    assert (verdict.by, verdict.values, verdict.fault) == ("cruise", (0.0, 0.0), "not finite")


def test_an_actuator_that_nothing_is_wired_to_idles_at_once() -> None:
    dispatch, verdict = Arbiter(DRIVE, (), TIMES).open(tick(), frozenset(), 0)
    assert isinstance(dispatch, Dispatch)
    assert isinstance(verdict, Verdict)
    assert verdict.fates == ()


def test_idle_hold_dispatches_nothing_to_send() -> None:
    hold = Actuator(name="say", fields=DRIVE.fields, server="DServer", command="Say", idle=None)
    dispatch, verdict = Arbiter(hold, (), TIMES).open(tick(), frozenset(), 0)
    assert isinstance(dispatch, Dispatch)
    assert dispatch.values is None
    assert isinstance(verdict, Verdict)
    assert verdict.values is None


BAD = [
    ("stranger", (1.0, 1.0), None, "is no client"),
    ("cruise", (1.0,), None, "1 values, not 2"),
    ("cruise", None, None, "without values"),
    ("cruise", (float("nan"), 0.0), None, "velocity = nan"),
    ("cruise", (float("inf"), 0.0), None, "velocity = inf"),
    ("cruise", (601.0, 0.0), None, "velocity = 601.0"),
    ("cruise", (True, 0.0), None, "velocity = True"),
    ("cruise", ("fast", 0.0), None, "velocity = 'fast'"),
]


@pytest.mark.parametrize(("client", "values", "fault", "text"), BAD)
def test_nothing_malformed_moves_a_robot(client: str, values: object, fault: str | None, text: str) -> None:
    bad = Request(k=0, actuator="drive", client=client, bid="command", values=values, fault=fault)  # type: ignore[arg-type]
    assert text in (malformed(bad, DRIVE, PLACES) or "")
    one = arbiter()
    one.open(tick(), frozenset(), 0)
    events = [*one.receive(bad, MS)]
    for other in PLACES:
        events += one.receive(request(other), MS)
    dispatch, verdict = events
    assert dispatch == Dispatch(0, None, (0.0, 0.0), None)
    assert isinstance(verdict, Verdict)
    assert text in verdict.notes[0]
    if client in PLACES:
        assert dict(verdict.fates)[client] == "refused"


def test_a_bool_field_takes_only_bools() -> None:
    lamp = Actuator(
        name="lamp",
        fields=(ActuatorField(name="on", type=BOOL),),
        server="DServer",
        command="Lamp",
        idle=None,
    )
    good = Request(k=0, actuator="lamp", client="a", bid="command", values=(True,))
    assert malformed(good, lamp, ("a",)) is None
    bad = Request(k=0, actuator="lamp", client="a", bid="command", values=(1.0,))
    assert malformed(bad, lamp, ("a",)) is not None


def test_values_are_told_in_declared_units() -> None:
    meters = Actuator(
        name="drive",
        fields=(ActuatorField(name="velocity", type=SPEED, factor=1000.0),),
        server="RServer",
        command="drive",
        idle=(0.0,),
    )
    one = Arbiter(meters, ("go",), TIMES)
    one.open(tick(), frozenset(), 0)
    go = Request(k=0, actuator="drive", client="go", bid="command", values=(300.0,))
    dispatch, verdict = one.receive(go, 0)
    assert isinstance(dispatch, Dispatch)
    assert dispatch.values == (300.0,)
    assert isinstance(verdict, Verdict)
    assert verdict.values == (0.3,)


def test_choose_waits_for_live_higher_clients_only() -> None:
    came = {"avoid": request("avoid", "command")}
    assert choose(PLACES, came, ()) == ("avoid", False)
    assert choose(PLACES, came, ("back_off",)) == ("avoid", True)
    assert choose(PLACES, {}, ()) == (None, False)
    assert choose((), {}, ()) == (None, True)
