"""CServer: a new image every period, handed out whole or in part, and frozen under the lock."""

from __future__ import annotations

import pytest

from colony.runtime.library import camera
from colony.runtime.protocol.calls import LEASE_NS
from colony.runtime.protocol.codec import MAX_MESSAGE_BYTES
from colony.runtime.protocol.images import Image
from colony.runtime.protocol.messages import Fetch, Send, ServerFrame, Tick
from colony.runtime.servers.cserver import CServer
from tests.runtime.asking import Asker, TroubleError

MS = 1_000_000
PERIOD = 500 * MS


class Film:
    """A camera that numbers its images from 1, in `t_ns`."""

    def __init__(self, width: int = 4) -> None:
        self.taken = 0
        self.covered = False
        self.width = width

    def grab(self) -> Image | None:
        if self.covered:
            return None
        self.taken += 1
        return Image(t_ns=self.taken, height=3, width=self.width, channels=1, pixels=bytes(3 * self.width))


def asker(film: Film | None = None, *names: str) -> Asker:
    one = Asker(CServer(film or Film(), frames_kept=4))
    for name in names or ("ann",):
        one.open(name)
    return one


def number(one: Asker, now_ns: int, name: str = "ann") -> int:
    """Which image the server has."""
    return one.do(name, camera.grab(), now_ns=now_ns).t_ns


def later(one: Asker, now_ns: int, *alive: str) -> None:
    """Let time pass, in which the connections of these names live."""
    while one.now_ns < now_ns:
        t_ns = min(one.now_ns + 250 * MS, now_ns)
        one.wake(t_ns)
        for name in alive:
            one.live(name, t_ns)


def test_it_grabs_once_a_period_however_often_it_is_asked() -> None:
    film = Film()
    one = asker(film)
    assert [number(one, t) for t in (0, 0, 100 * MS, 499 * MS)] == [1, 1, 1, 1]
    later(one, PERIOD, "ann")
    assert [number(one, t) for t in (PERIOD, 999 * MS)] == [2, 2]
    later(one, 10 * PERIOD, "ann")
    assert number(one, 10 * PERIOD) == film.taken == 11


def test_a_server_that_slept_takes_one_image_and_keeps_its_beat() -> None:
    one = asker()
    one.wakes.clear()
    one.wake(7 * PERIOD + 3)
    one.open("bob", now_ns=7 * PERIOD + 3)
    assert number(one, 7 * PERIOD + 3, "bob") == 2
    assert 8 * PERIOD in one.wakes


def test_size_and_rows() -> None:
    one = asker()
    assert one.do("ann", camera.size()) == camera.ImageSize(height=3, width=4, channels=1)
    band = one.do("ann", camera.grab_rows(1, 2))
    assert (band.first_row, band.height, band.t_ns) == (1, 2, 1)
    with pytest.raises(TroubleError, match="expected at least 1 of rows 0 to 2") as trouble:
        one.do("ann", camera.grab_rows(2, 2))
    assert trouble.value.code == "arguments"


def test_under_the_lock_the_image_stays() -> None:
    one = asker(None, "ann", "bob")
    one.do("ann", camera.lock())
    later(one, 4 * PERIOD, "ann", "bob")
    assert number(one, 4 * PERIOD) == number(one, 4 * PERIOD, "bob") == 1
    one.do("ann", camera.unlock(), now_ns=4 * PERIOD)
    assert number(one, 4 * PERIOD) == 2
    later(one, 5 * PERIOD, "ann", "bob")
    assert number(one, 5 * PERIOD) == 3


def test_who_waits_for_the_lock_gets_it_with_a_new_image() -> None:
    one = asker(None, "ann", "bob")
    one.do("ann", camera.lock())
    waiting = one.send("bob", camera.lock(wait_s=60.0))
    later(one, 2 * PERIOD, "ann", "bob")
    assert not one.answered("bob", waiting)
    one.do("ann", camera.unlock(), now_ns=2 * PERIOD)
    one.answer("bob", camera.lock(), waiting)
    assert number(one, 2 * PERIOD) == 2
    later(one, 4 * PERIOD, "ann", "bob")
    assert number(one, 4 * PERIOD) == 2


def test_who_does_not_wait_or_not_long_enough_is_refused() -> None:
    one = asker(None, "ann", "bob")
    one.do("ann", camera.lock())
    with pytest.raises(TroubleError, match="ann holds the lock") as trouble:
        one.do("bob", camera.lock())
    assert trouble.value.code == "locked"
    waiting = one.send("bob", camera.lock(wait_s=0.3))
    later(one, 299 * MS, "ann", "bob")
    assert not one.answered("bob", waiting)
    later(one, 300 * MS, "ann", "bob")
    with pytest.raises(TroubleError, match="ann holds the lock"):
        one.answer("bob", camera.lock(), waiting)
    with pytest.raises(TroubleError) as trouble:
        one.do("bob", camera.unlock(), now_ns=300 * MS)
    assert trouble.value.code == "unlocked"


def test_a_dead_holder_loses_the_lock_to_the_most_important_who_waits() -> None:
    one = asker(None, "ann")
    one.open("bob", priority=1)
    one.open("cy", priority=2)
    one.do("ann", camera.lock())
    bob = one.send("bob", camera.lock(wait_s=60.0), priority=1)
    cy = one.send("cy", camera.lock(wait_s=60.0), priority=2)
    later(one, LEASE_NS + 1, "bob", "cy")
    assert (one.answered("bob", bob), one.answered("cy", cy)) == (False, True)
    later(one, 2 * LEASE_NS + 2, "bob", "cy")
    assert not one.answered("bob", bob)


def test_the_period_can_be_changed_within_reason() -> None:
    one = asker()
    assert one.do("ann", camera.period()) == PERIOD
    one.do("ann", camera.set_period(0.1))
    assert one.do("ann", camera.period()) == 100 * MS
    later(one, 1000 * MS, "ann")
    assert number(one, 1000 * MS) == 11
    for seconds in (0.0, -1.0, 0.005, 1e6):
        with pytest.raises(TroubleError, match=r"expected 0\.01 to 3600 s"):
            one.do("ann", camera.set_period(seconds), now_ns=1000 * MS)


def test_a_camera_that_is_gone_gives_no_image_and_comes_back() -> None:
    film = Film()
    film.covered = True
    one = asker(film)
    for ask in (camera.grab(), camera.size(), camera.grab_rows(0)):
        with pytest.raises(TroubleError, match="no image") as trouble:
            one.do("ann", ask)
        assert trouble.value.code == "no image"
    film.covered = False
    assert number(one, 1) == 1
    film.covered = True
    later(one, PERIOD, "ann")
    with pytest.raises(TroubleError):
        number(one, PERIOD)


def test_an_image_too_large_for_a_message_can_be_had_in_rows() -> None:
    one = asker(Film(width=MAX_MESSAGE_BYTES // 2))
    with pytest.raises(TroubleError, match="grab rows") as trouble:
        one.do("ann", camera.grab())
    assert trouble.value.code == "too large"
    assert one.do("ann", camera.grab_rows(2)).width == MAX_MESSAGE_BYTES // 2


def test_it_answers_ticks_with_empty_frames() -> None:
    server = CServer(Film(), frames_kept=4, address="CServerUp")
    one = Asker(server)
    effects = list(server.handle(Tick(k=3, t_ns=5), 5))
    (frame,) = (e.message for e in effects if isinstance(e, Send))
    assert isinstance(frame, ServerFrame)
    assert (frame.server, frame.k, dict(frame.fields)) == ("CServerUp", 3, {})
    assert list(server.handle(Fetch(server="CServerUp", k=3), 6)) == effects
    assert set(one.server.listens) >= {"CServerUp/call", "CServerUp/fetches", "Clock/ticks"}
