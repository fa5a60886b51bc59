"""What a guard writes: whole packets in the order of their urgency, no faster than the line."""

from __future__ import annotations

import random

from colony.drivers.guard import MAX_WAITING, REPEATS_NS, PacketQueue

MS = 1_000_000


def written(outbox: PacketQueue, now_ns: int) -> list[bytes]:
    packets = []
    while packet := outbox.next(now_ns):
        packets.append(packet)
        outbox.wrote(packet, len(packet), now_ns)
    return packets


def test_the_newest_decision_alone_is_sent_and_first() -> None:
    outbox = PacketQueue(0)
    outbox.add(b"query")
    outbox.decide(b"old")
    outbox.decide(b"new")
    assert written(outbox, 0) == [b"new", b"query"]
    assert outbox.due_ns() is None


def test_a_stop_with_a_new_driver_drops_what_waits_and_is_repeated() -> None:
    outbox = PacketQueue(0)
    outbox.add(b"query")
    outbox.decide(b"go")
    outbox.stop(b"stop", 0)
    times = [t for t in range(0, 1000 * MS, MS) if written(outbox, t) == [b"stop"]]
    assert times == list(REPEATS_NS)


def test_a_stop_may_leave_the_last_settings_of_an_opening() -> None:
    outbox = PacketQueue(0)
    outbox.add(b"enable")
    outbox.decide(b"go")
    outbox.stop(b"stop", 0, drops_plain=False)
    assert written(outbox, 0) == [b"stop", b"enable"]


def test_a_decision_ends_the_repeats() -> None:
    outbox = PacketQueue(0)
    outbox.stop(b"stop", 0)
    assert written(outbox, 0) == [b"stop"]
    outbox.decide(b"go")
    assert written(outbox, 1000 * MS) == [b"go"]


def test_a_channel_replaces_and_stops_only_what_is_its_own() -> None:
    outbox = PacketQueue(0)
    for packet, channel in ((b"old", 0), (b"grip", 1), (b"go", 0)):
        outbox.decide(packet, channel)
    assert written(outbox, 0) == [b"go", b"grip"]
    outbox.decide(b"go", 0)
    outbox.decide(b"grip", 1)
    outbox.stop(b"open", 0, 1)
    assert written(outbox, 0) == [b"open", b"go"]
    outbox.decide(b"go", 0)
    times = [t for t in range(MS, 1000 * MS, MS) if b"open" in written(outbox, t)]
    assert times == list(REPEATS_NS[1:])


def test_decisions_of_several_channels_take_turns() -> None:
    outbox, sent = PacketQueue(9600), b""
    for i in range(40):  # faster than the line, which takes 5 ms for each
        for channel, packet in enumerate((b"<go> ", b"<jaw>")):
            outbox.decide(packet, channel)
        sent += b"".join(written(outbox, 3 * i * MS))
    assert abs(sent.count(b"<go> ") - sent.count(b"<jaw>")) <= 1


def test_a_stop_is_sent_although_another_channel_keeps_the_line_busy() -> None:
    outbox = PacketQueue(9600)
    outbox.stop(b"open", 0, 1)
    for i in range(10):
        outbox.decide(b"go", 0)
        written(outbox, i * MS)
    assert outbox.is_sent(9 * MS, 1, unsent=2)
    assert not outbox.is_sent(9 * MS, 1, unsent=6)
    assert outbox.is_sent(9 * MS, 0, unsent=2) is False
    assert outbox.is_sent(9 * MS, 2) is None


def test_a_stop_is_sent_once_the_line_has_carried_all_of_it() -> None:
    outbox = PacketQueue(9600)
    assert outbox.is_sent(0) is None
    outbox.stop(b"stop", 0)
    packet = outbox.next(0)
    outbox.wrote(packet, 2, 0)
    assert outbox.is_sent(10 * MS) is False
    outbox.wrote(outbox.next(10 * MS), 2, 10 * MS)
    assert [outbox.is_sent(10 * MS), outbox.is_sent(13 * MS)] == [False, True]
    outbox.add(b"query")
    outbox.decide(b"go")
    assert written(outbox, 20 * MS) == [b"go"]
    assert outbox.is_sent(30 * MS)
    outbox.clear()
    assert outbox.is_sent(40 * MS) is None


def test_nothing_waits_where_it_cannot_be_dropped() -> None:
    outbox = PacketQueue(9600)  # 9 bytes take 9.375 ms
    outbox.add(b"nine byte")
    outbox.add(b"dropped")
    assert written(outbox, 0) == [b"nine byte"]
    assert outbox.due_ns() == 9_375_000
    outbox.stop(b"stop", 5 * MS)
    assert written(outbox, 5 * MS) == []
    assert written(outbox, 9_375_000) == [b"stop"]


def test_no_packet_is_torn_whatever_the_port_takes() -> None:
    rng = random.Random(1)
    for _ in range(300):
        outbox, wire, now_ns = PacketQueue(rng.choice((0, 9600))), b"", 0
        for _ in range(60):
            match rng.randrange(4):
                case 0:
                    outbox.add(b"<plain>")
                case 1:
                    outbox.decide(b"<decided>", rng.randrange(2))
                case 2:
                    outbox.stop(b"<stop>", now_ns, rng.randrange(2))
                case _:
                    now_ns += rng.randrange(20 * MS)
            if packet := outbox.next(now_ns):
                taken = rng.randrange(len(packet) + 1)
                wire += packet[:taken]
                outbox.wrote(packet, taken, now_ns)
        frames = wire.replace(b"<plain>", b"").replace(b"<decided>", b"").replace(b"<stop>", b"")
        assert any(whole.startswith(frames) for whole in (b"<plain>", b"<decided>", b"<stop>")), wire


def test_plain_packets_are_limited() -> None:
    outbox = PacketQueue(0)
    for _ in range(2 * MAX_WAITING):
        outbox.add(b"x")
    assert len(written(outbox, 0)) == MAX_WAITING
