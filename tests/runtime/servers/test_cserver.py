"""CServer: a new image every period, handed out whole or in part, and frozen under the lock."""

from __future__ import annotations

from colony.runtime.library import camera
from colony.runtime.protocol.calls import LEASE_NS
from colony.runtime.protocol.codec import MAX_MESSAGE_BYTES
from colony.runtime.protocol.images import Image
from colony.runtime.protocol.messages import Fetch, Tick
from colony.runtime.servers.cserver import CServer
from tests.kit.node_stage import MS, Caller, NodeStage

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


def people(film: Film | None = None, **priorities: int) -> tuple[Caller, ...]:
    """Connections of these names and priorities to a server."""
    made = NodeStage(CServer(film or Film(), frames_kept=4))
    return tuple(made.connect(f"{name}/1", priority) for name, priority in priorities.items())


def number(caller: Caller) -> int:
    """Which image the server has."""
    return caller.do(camera.grab()).t_ns


def later(t_ns: int, *alive: Caller) -> None:
    """Let time pass, in which these connections live."""
    alive[0].stage.until(t_ns, alive)


def test_it_grabs_once_a_period_however_often_it_is_asked() -> None:
    film = Film()
    (ann,) = people(film, ann=0)
    for t_ns, image in ((0, 1), (0, 1), (100 * MS, 1), (499 * MS, 1), (PERIOD, 2), (999 * MS, 2)):
        later(t_ns, ann)
        assert number(ann) == image
    later(10 * PERIOD, ann)
    assert number(ann) == film.taken == 11


def test_a_server_that_slept_takes_one_image_and_keeps_its_beat() -> None:
    (ann,) = people(ann=0)
    ann.stage.wakes.clear()
    ann.stage.now_ns = 7 * PERIOD + 3
    ann.stage.wake()
    assert number(ann.stage.connect("bob/1")) == 2
    assert 8 * PERIOD in ann.stage.wakes


def test_size_and_rows() -> None:
    (ann,) = people(ann=0)
    assert ann.do(camera.size()) == camera.ImageSize(height=3, width=4, channels=1)
    band = ann.do(camera.grab_rows(1, 2))
    assert (band.first_row, band.height, band.t_ns) == (1, 2, 1)
    problem = ann.problem(camera.grab_rows(2, 2))
    assert problem.code == "arguments"
    assert "expected at least 1 of rows 0 to 2" in problem.message


def test_under_the_lock_the_image_stays() -> None:
    ann, bob = people(ann=0, bob=0)
    ann.do(camera.lock())
    later(4 * PERIOD, ann, bob)
    assert number(ann) == number(bob) == 1
    ann.do(camera.unlock())
    assert number(ann) == 2
    later(5 * PERIOD, ann, bob)
    assert number(ann) == 3


def test_who_waits_for_the_lock_gets_it_with_a_new_image() -> None:
    ann, bob = people(ann=0, bob=0)
    ann.do(camera.lock())
    bob.begin(camera.lock(wait_s=60.0))
    later(2 * PERIOD, ann, bob)
    assert bob.last is None
    ann.do(camera.unlock())
    assert bob.last.problem is None
    assert number(ann) == 2
    later(4 * PERIOD, ann, bob)
    assert number(ann) == 2


def test_who_does_not_wait_or_not_long_enough_is_refused() -> None:
    ann, bob = people(ann=0, bob=0)
    ann.do(camera.lock())
    problem = bob.problem(camera.lock())
    assert problem.code == "locked"
    assert "ann holds the lock" in problem.message
    bob.begin(camera.lock(wait_s=0.3))
    later(299 * MS, ann, bob)
    assert bob.last is None
    later(300 * MS, ann, bob)
    assert "ann holds the lock" in bob.last.problem.message
    assert bob.refusal(camera.unlock()) == "unlocked"


def test_a_dead_holder_loses_the_lock_to_the_most_important_who_waits() -> None:
    ann, bob, cy = people(ann=0, bob=1, cy=2)
    ann.do(camera.lock())
    for one in (bob, cy):
        one.begin(camera.lock(wait_s=60.0))
    later(LEASE_NS + 1, bob, cy)
    assert (bob.last, cy.last is None) == (None, False)
    later(2 * LEASE_NS + 2, bob, cy)
    assert bob.last is None


def test_the_period_can_be_changed_within_reason() -> None:
    (ann,) = people(ann=0)
    assert ann.do(camera.period()) == PERIOD
    ann.do(camera.set_period(0.1))
    assert ann.do(camera.period()) == 100 * MS
    later(1000 * MS, ann)
    assert number(ann) == 11
    for seconds in (0.0, -1.0, 0.005, 1e6):
        assert "expected 0.01 to 3600 s" in ann.problem(camera.set_period(seconds)).message


def test_a_camera_that_is_gone_gives_no_image_and_comes_back() -> None:
    film = Film()
    film.covered = True
    (ann,) = people(film, ann=0)
    for ask in (camera.grab(), camera.size(), camera.grab_rows(0)):
        assert ann.refusal(ask) == "no image"
    film.covered = False
    ann.stage.now_ns = 1
    assert number(ann) == 1
    film.covered = True
    later(PERIOD, ann)
    assert ann.refusal(camera.grab()) == "no image"


def test_an_image_too_large_for_a_message_can_be_had_in_rows() -> None:
    (ann,) = people(Film(width=MAX_MESSAGE_BYTES // 2), ann=0)
    problem = ann.problem(camera.grab())
    assert problem.code == "too large"
    assert "grab rows" in problem.message
    assert ann.do(camera.grab_rows(2)).width == MAX_MESSAGE_BYTES // 2


def test_it_answers_ticks_with_empty_frames() -> None:
    stage = NodeStage(CServer(Film(), frames_kept=4, address="CServerUp"))
    frame = stage.server_frame(Tick(k=3, t_ns=5))
    assert (frame.server, frame.k, dict(frame.fields)) == ("CServerUp", 3, {})
    assert stage.server_frame(Fetch(server="CServerUp", k=3)) == frame
    assert set(stage.node.listens) >= {"CServerUp/call", "CServerUp/fetches", "Clock/ticks"}
