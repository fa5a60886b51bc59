"""Arbitration as tables: what comes in, what is dispatched, and what the verdict says of everybody."""

from __future__ import annotations

import itertools

import pytest

from colony.ir.program import Actuator, ActuatorField
from colony.ir.servers import SPEED
from colony.ir.types import BOOL
from colony.runtime.arbitration.arbiter import (
    MAX_FRAMES_AHEAD,
    Arbiter,
    Dispatch,
    timing,
)
from colony.runtime.arbitration.ballot import (
    Ballot,
    ClientRanking,
    Interventions,
    OutsideCommand,
    request_error,
)
from colony.runtime.protocol.messages import Request, Tick, Verdict
from tests.runtime.arbitration.drive import COMMANDS, DRIVE, MS, PLACES, TIMES, arbiter, request, table, tick


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


@pytest.mark.parametrize(
    ("handled_ns", "winner", "late"),
    [
        (39 * MS, "cruise", ()),
        (60 * MS, "cruise", ()),  # held up: all of them waited in the process, so nobody is late
        (80 * MS, None, ("avoid", "cruise")),  # too old to be waited for
    ],
)
def test_a_process_that_was_held_up_finds_nobody_late_who_waits_in_it(
    one: Arbiter, handled_ns: int, winner: str | None, late: tuple[str, ...]
) -> None:
    one.open(tick(), frozenset(), 0)
    bids = ("back_off", "silent"), ("avoid", "silent"), ("cruise", "command")
    events = [e for client, bid in bids for e in one.receive(request(client, bid), handled_ns)]
    (dispatch,) = (event for event in events if isinstance(event, Dispatch))
    (verdict,) = (event for event in events if isinstance(event, Verdict))
    assert dispatch.by == verdict.by == winner
    assert tuple(client for client, fate in verdict.fates if fate == "late") == late


def test_who_is_heard_after_a_late_decision_that_it_cannot_change_is_not_late(one: Arbiter) -> None:
    one.open(tick(), frozenset(), 0)
    for client, bid in (("back_off", "command"), ("avoid", "silent"), ("cruise", "silent")):
        events = one.receive(request(client, bid), 60 * MS)
    (verdict,) = events
    assert isinstance(verdict, Verdict)
    assert dict(verdict.fates) == {"back_off": "won", "avoid": "silent", "cruise": "silent"}


@pytest.mark.parametrize("told_ns", [-10_000 * MS, 0, 10_000 * MS])
def test_in_lockstep_the_deadline_counts_from_when_the_tick_came(told_ns: int) -> None:
    one = Arbiter(table(DRIVE, *PLACES), timing(50 * MS, lockstep=True))
    came_ns = 20_000 * MS
    assert one.open(Tick(k=0, t_ns=came_ns + told_ns), frozenset(), came_ns) == ()
    assert one.wake_at == came_ns + 40 * MS
    assert one.wake(came_ns + 40 * MS - 1) == ()
    dispatch, *_ = one.wake(came_ns + 40 * MS)
    assert dispatch.by is None
    assert one.receive(request("cruise", "command"), came_ns + 41 * MS) == ()
    (verdict,) = one.open(Tick(k=1, t_ns=came_ns + told_ns + 50 * MS), frozenset(), came_ns + 45 * MS)
    assert dict(verdict.fates) == dict.fromkeys(PLACES, "late")


@pytest.mark.parametrize("order", list(itertools.permutations(PLACES)))
def test_of_two_commands_one_goes_out_and_it_is_the_higher_in_any_order(order: tuple[str, ...]) -> None:
    bids = {"back_off": "silent", "avoid": "command", "cruise": "command"}
    dispatches, (verdict,) = run(*((c, bids[c]) for c in order))
    assert [d.values for d in dispatches] == [COMMANDS["avoid"]]
    assert verdict.violation
    assert dict(verdict.fates) == {"back_off": "silent", "avoid": "won", "cruise": "overruled"}


def test_the_command_goes_out_as_soon_as_nobody_higher_is_missing(one: Arbiter) -> None:
    one.open(tick(), frozenset(), 0)
    assert one.receive(request("back_off"), MS) == ()
    assert one.receive(request("avoid", "command"), MS) == (Dispatch(0, "avoid", (80.0, 30.0), None),)
    (verdict,) = one.receive(request("cruise"), 2 * MS)
    assert isinstance(verdict, Verdict)
    assert one.wake_at is None


def test_a_silent_higher_client_delays_a_command_by_the_grace_at_most(one: Arbiter) -> None:
    one.open(tick(), frozenset(), 0)
    assert one.wake_at == 40 * MS
    assert one.receive(request("cruise", "command"), 2 * MS) == ()
    assert one.wake_at == 7 * MS
    assert one.wake(7 * MS - 1) == ()
    (dispatch,) = one.wake(7 * MS)
    assert dispatch.by == "cruise"


def test_idle_at_the_deadline_and_what_comes_later_is_late(one: Arbiter) -> None:
    one.open(tick(), frozenset(), 0)
    one.receive(request("avoid"), MS)
    one.receive(request("cruise"), MS)
    assert one.wake(40 * MS) == (Dispatch(0, None, (0.0, 0.0), None),)
    (verdict,) = one.receive(request("back_off", "command"), 41 * MS)
    assert verdict.by is None
    assert dict(verdict.fates)["back_off"] == "late"
    assert verdict.notes == ("`back_off` commanded after the deadline",)


def test_requests_may_come_before_their_tick_and_twice(one: Arbiter) -> None:
    for client in PLACES:
        assert one.receive(request(client, "command" if client == "cruise" else "silent"), 0) == ()
    dispatch, verdict = one.open(tick(), frozenset(), MS)
    assert dispatch.by == "cruise"
    assert isinstance(verdict, Verdict)
    assert one.receive(request("back_off", "command"), 2 * MS) == ()


def test_requests_of_other_frames_change_nothing(one: Arbiter) -> None:
    one.open(tick(5), frozenset(), 250 * MS)
    assert one.receive(request("back_off", "command", k=4), 251 * MS) == ()
    assert one.receive(request("back_off", "command", k=6 + MAX_FRAMES_AHEAD), 251 * MS) == ()
    assert one.open(tick(5), frozenset(), 251 * MS) == ()
    assert one.open(tick(4), frozenset(), 251 * MS) == ()


def test_a_frame_without_a_wake_ends_with_the_next_tick(one: Arbiter) -> None:
    one.open(tick(0), frozenset(), 0)
    dispatch, verdict = one.open(tick(1), frozenset(), 50 * MS)
    assert dispatch == Dispatch(0, None, (0.0, 0.0), None)
    assert verdict.k == 0
    assert one.finish()[0] == Dispatch(1, None, (0.0, 0.0), None)
    assert one.finish() == ()


def test_a_command_that_is_not_finite_wins_and_sends_the_idle_command() -> None:
    one = Arbiter(table(DRIVE, "cruise"), TIMES)
    one.open(tick(), frozenset(), 0)
    bad = Request(k=0, actuator="drive", client="cruise", bid="command", fault="not finite")
    dispatch, verdict = one.receive(bad, MS)
    assert dispatch == Dispatch(0, "cruise", (0.0, 0.0), "not finite")
    assert (verdict.by, verdict.values, verdict.fault) == ("cruise", (0.0, 0.0), "not finite")


def test_an_actuator_that_nothing_is_wired_to_idles_at_once() -> None:
    dispatch, verdict = Arbiter(table(DRIVE), TIMES).open(tick(), frozenset(), 0)
    assert isinstance(dispatch, Dispatch)
    assert verdict.fates == ()


def test_idle_hold_dispatches_nothing_to_send() -> None:
    hold = Actuator(name="say", fields=DRIVE.fields, server="DServer", command="Say", idle=None)
    dispatch, verdict = Arbiter(table(hold), TIMES).open(tick(), frozenset(), 0)
    assert dispatch.values is None
    assert verdict.values is None


BAD = [
    ("stranger", (1.0, 1.0), None, "is not a client"),
    ("cruise", (1.0,), None, "1 values, expected 2"),
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
    assert text in (request_error(bad, table(DRIVE), PLACES) or "")
    one = arbiter()
    one.open(tick(), frozenset(), 0)
    events = [*one.receive(bad, MS)]
    for other in PLACES:
        events += one.receive(request(other), MS)
    dispatch, verdict = events
    assert dispatch == Dispatch(0, None, (0.0, 0.0), None)
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
    assert request_error(good, table(lamp), ("a",)) is None
    bad = Request(k=0, actuator="lamp", client="a", bid="command", values=(1.0,))
    assert request_error(bad, table(lamp), ("a",)) is not None


def test_values_are_told_in_declared_units() -> None:
    meters = Actuator(
        name="drive",
        fields=(ActuatorField(name="velocity", type=SPEED, factor=1000.0),),
        server="RServer",
        command="drive",
        idle=(0.0,),
    )
    one = Arbiter(table(meters, "go"), TIMES)
    one.open(tick(), frozenset(), 0)
    go = Request(k=0, actuator="drive", client="go", bid="command", values=(300.0,))
    dispatch, verdict = one.receive(go, 0)
    assert dispatch.values == (300.0,)
    assert verdict.values == (0.3,)


def outside(priority: int, *values: float, connection: str = "ann/1") -> OutsideCommand:
    return OutsideCommand(connection, priority, values or (10.0, 0.0))


def choice(came: str, interventions: Interventions, lost: str = "") -> tuple[str | None, bool]:
    """Who would act, by the bids of the three clients as in the table above, and whether that is settled."""
    ballot = Ballot(ClientRanking(tuple(zip(PLACES, (6, 4, 2), strict=True))), lost.split())
    for client, letter in zip(PLACES, came, strict=True):
        if letter == "x":
            ballot.exclude(client)
        elif letter != "-":
            ballot.take(request(client, "command" if letter == "c" else "silent"))
    by, acts, settled = ballot.choose(interventions)
    assert by is None or acts is None
    return (by if acts is None else acts.connection), settled


BESIDES = [
    # priority from outside, requests, lost, who would act, settled
    ("above all, it acts at once", 7, "---", "", "ann/1", True),
    ("above all, it takes the winner's place", 7, "css", "", "ann/1", True),
    ("below all, it waits for everybody", 1, "ss-", "", None, False),
    ("below all, it acts when all are silent", 1, "sss", "", "ann/1", True),
    ("below all, it gives way", 1, "ssc", "", "cruise", True),
    ("what a lost client wants is not known", 1, "-ss", "back_off", None, True),
    ("nor what a refused one wants", 1, "xss", "", None, True),
    ("a late one keeps it waiting", 1, "-ss", "", None, False),
    ("between, it waits for those above", 5, "---", "", None, False),
    ("between, it does not wait for those below", 5, "s--", "", "ann/1", True),
    ("between, it gives way to those above", 5, "c--", "", "back_off", True),
    ("between, it takes the place of those below", 5, "ssc", "", "ann/1", True),
    ("whoever wins below, those above are inactive", 5, "--c", "", "ann/1", False),
    ("also where they are lost", 5, "--c", "back_off", "ann/1", False),
    ("lost above, nothing known below", 5, "-s-", "back_off", None, False),
]


@pytest.mark.parametrize(("priority", "came", "lost", "who", "settled"), [b[1:] for b in BESIDES])
def test_commands_from_outside(priority: int, came: str, lost: str, who: str | None, settled: bool) -> None:
    assert choice(came, Interventions((outside(priority),)), lost) == (who, settled)


def test_of_those_outside_only_the_first_counts() -> None:
    both = Interventions((outside(9), outside(1, connection="bob/1")))
    assert choice("sss", both) == ("ann/1", True)


def naive(came: dict[str, str], lost: set[str], priority: int | None) -> tuple[str | None, bool]:
    """The rule again, in the order in which one would say it."""
    ranks = dict(zip(PLACES, (6, 4, 2), strict=True))
    known = {c: b for c, b in came.items() if c not in lost}
    commands = [c for c in PLACES if known.get(c) == "command"]
    winner = commands[0] if commands else None
    live_unheard = [c for c in PLACES if c not in lost and c not in came]
    if priority is not None and (winner is None or ranks[winner] < priority):
        above = [c for c in PLACES if ranks[c] > priority]
        if all(c in known for c in above):
            return "ann/1", True
        if winner is not None:
            return "ann/1", False
        return None, not live_unheard
    if winner is not None:
        return winner, not any(ranks[c] > ranks[winner] for c in live_unheard)
    return None, not live_unheard


def test_the_rule_is_the_same_however_it_is_computed() -> None:
    states = ("absent", "silent", "command", "lost", "lost and silent", "lost and command")
    for by_client in itertools.product(states, repeat=3):
        for priority in (None, 1, 3, 5, 7):
            bids = dict(zip(PLACES, by_client, strict=True))
            came = {c: b.split()[-1] for c, b in bids.items() if b not in ("absent", "lost")}
            lost = {c for c, b in bids.items() if b.startswith("lost")}
            ballot = Ballot(ClientRanking(tuple(zip(PLACES, (6, 4, 2), strict=True))), lost)
            for client in reversed([c for c in PLACES if c in came]):
                ballot.take(request(client, came[client]))
            by, acts, settled = ballot.choose(Interventions(() if priority is None else (outside(priority),)))
            who = by if acts is None else acts.connection
            assert (who, settled) == naive(came, lost, priority), (bids, priority)


def test_a_command_from_outside_within_a_frame_acts_in_it_unless_it_is_decided(one: Arbiter) -> None:
    one.open(tick(), frozenset(), 0)
    (dispatch,) = one.intervene(Interventions((outside(9),)), 2 * MS)
    assert dispatch == Dispatch(0, None, (10.0, 0.0), None, "ann/1")
    assert one.intervene(Interventions((outside(9, 20.0, 0.0),)), 3 * MS) == ()
    for client in PLACES:
        events = one.receive(request(client, "command" if client == "cruise" else "silent"), 4 * MS)
    (verdict,) = events
    assert (verdict.by, verdict.outside, verdict.values) == (None, "ann/1", (10.0, 0.0))
    assert dict(verdict.fates)["cruise"] == "overridden"


def test_verdicts_name_everyone_outside_who_did_not_get_through(one: Arbiter) -> None:
    both = (outside(9), outside(0, connection="bob/1"))
    one.open(tick(), frozenset(), 0, Interventions(both))
    (verdict,) = [e for e in one.finish() if isinstance(e, Verdict)]
    assert verdict.fates[-1] == ("bob/1", "overridden")
    for hold, fate in (("locked", "locked out"), ("stopped", "stopped")):
        one = arbiter()
        one.open(tick(), frozenset(), 0, Interventions(both, hold, "cy/1"))  # type: ignore[arg-type]
        one.receive(request("avoid", "command"), MS)
        (verdict,) = [e for e in one.finish() if isinstance(e, Verdict)]
        assert (verdict.hold, verdict.by, verdict.outside, verdict.values) == (hold, None, None, (0.0, 0.0))
        assert dict(verdict.fates) == {
            "back_off": "late",
            "avoid": fate,
            "cruise": "late",
            "ann/1": fate,
            "bob/1": fate,
        }


def test_requests_for_the_first_frame_may_come_before_its_tick_whatever_its_number(one: Arbiter) -> None:
    for client in PLACES:
        one.receive(request(client, "command" if client == "cruise" else "silent", k=10**12), 0)
    dispatch, _ = one.open(tick(10**12), frozenset(), 10**12 * 50 * MS)
    assert dispatch.by == "cruise"
