"""An action of the bridge, at given times: which goals it sends and cancels, and what it reports of them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from colony.ros2.bridge.actions import (
    CANCEL_AGAIN_NS,
    NUMBER,
    PREEMPT_NS,
    SEND_AGAIN_NS,
    OutputAction,
)
from colony.ros2.bridge.topics import CDR

TYPE = "fake_msgs/action/Walk"
MS = 1_000_000
TIMEOUT_NS = 250 * MS
ACCEPTED, EXECUTING, CANCELING, SUCCEEDED, CANCELED, ABORTED = range(1, 7)


class Reply:
    """A future of rclpy. Mutable: done once it has a result."""

    def __init__(self) -> None:
        self._then: Callable[[Any], None] | None = None
        self._result: Any = None

    def add_done_callback(self, then: Callable[[Any], None]) -> None:
        self._then = then

    def answer(self, **result: Any) -> None:
        self._result = SimpleNamespace(**result)
        assert self._then is not None
        self._then(self)

    def exception(self) -> None:
        return None

    def result(self) -> Any:
        return self._result


class Client:
    """A client of a service. Mutable: has the requests, with the futures of their answers."""

    def __init__(self, server: Server) -> None:
        self._server = server
        self.requests: list[tuple[Any, Reply]] = []

    def service_is_ready(self) -> bool:
        return bool(self._server.gids)

    def call_async(self, request: Any) -> Reply:
        self.requests.append((request, Reply()))
        return self.requests[-1][1]


class Server:
    """The node of the bridge, and what it sees of an action server. Mutable."""

    def __init__(self) -> None:
        self.gids = [b"first"]
        self.clients: dict[str, Client] = {}
        self.listens: dict[str, Callable[[Any], None]] = {}

    def get_name(self) -> str:
        return "colony"

    def get_namespace(self) -> str:
        return "/"

    def resolve_topic_name(self, name: str) -> str:
        return f"/{name}"

    def create_client(self, type_: Any, name: str) -> Client:
        return self.clients.setdefault(name.rpartition("/")[2], Client(self))

    def create_subscription(self, type_: Any, name: str, callback: Any, profile: Any, **options: Any) -> None:
        self.listens[name.rpartition("/")[2]] = callback

    def get_publishers_info_by_topic(self, name: str) -> list[Any]:
        quality = SimpleNamespace(reliability="reliable", durability="transient_local")
        end = {"node_name": "walker", "node_namespace": "/", "topic_type": "t", "qos_profile": quality}
        return [SimpleNamespace(endpoint_gid=gid, **end) for gid in self.gids]


class Stage:
    """An action between a fake pipe and a fake server. Mutable."""

    def __init__(self) -> None:
        self.now_ns = 0
        self.server = Server()
        self.reports: list[tuple[int, str]] = []
        self.acknowledged: list[int] = []
        self.action = OutputAction(
            {"topic": "walk", "type": TYPE, "timeout_ms": TIMEOUT_NS / MS},
            wake=lambda: self.action.step(),
            report=lambda number, state: self.reports.append((number, state)),
            acknowledge=lambda number: self.acknowledged.append(number),
            clock=lambda: self.now_ns,
        )
        self.look()

    def look(self) -> dict[str, Any]:
        """Look at the graph."""
        return self.action.look(self.server, 0)

    def decide(self, number: int, message: bytes = b"goal") -> None:
        """Decide a goal."""
        self.action.decide(self.now_ns, NUMBER.pack(number) + message, self.now_ns)

    def sent(self) -> list[Any]:
        """Return the goals that were sent."""
        return [request.goal for request, _ in self.server.clients["send_goal"].requests]

    def answer(self, *, accepted: bool = True) -> bytes:
        """Answer the newest goal, and return its id."""
        request, reply = self.server.clients["send_goal"].requests[-1]
        reply.answer(accepted=accepted)
        return bytes(request.goal_id.uuid)

    def status(self, *states: tuple[bytes, int]) -> None:
        """Publish the states of goals."""
        infos = [(SimpleNamespace(goal_id=SimpleNamespace(uuid=list(i))), state) for i, state in states]
        rows = [SimpleNamespace(goal_info=info, status=state) for info, state in infos]
        self.server.listens["status"](SimpleNamespace(status_list=rows))

    def canceled(self) -> list[bytes]:
        """Return the ids of the goals whose cancellation was sent."""
        requests = self.server.clients["cancel_goal"].requests
        return [bytes(request.goal_info.goal_id.uuid) for request, _ in requests]

    def agree(self, *goals: bytes) -> None:
        """Answer the newest cancellation; without a goal as a server in rclpy does that refuses it."""
        infos = [SimpleNamespace(goal_id=SimpleNamespace(uuid=list(goal))) for goal in goals]
        _, reply = self.server.clients["cancel_goal"].requests[-1]
        reply.answer(return_code=0, goals_canceling=infos)

    def wait(self, for_ns: int) -> None:
        """Let time pass, without a decision."""
        self.now_ns += for_ns
        self.action.tick(self.now_ns)
        self.look()


@pytest.fixture(autouse=True)
def _fake_rclpy(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("FAKE_RCLPY", str(tmp_path))
    monkeypatch.syspath_prepend(str(Path(__file__).with_name("fake")))


@pytest.fixture
def stage() -> Stage:
    return Stage()


def test_a_goal_is_sent_once_and_followed_to_its_end(stage: Stage) -> None:
    stage.decide(1)
    stage.decide(1)
    goal = stage.answer()
    stage.status((goal, EXECUTING))
    stage.decide(1)
    stage.status((goal, SUCCEEDED))
    stage.decide(1)
    assert stage.sent() == [b"goal"]
    assert list(dict.fromkeys(stage.reports)) == [(1, "sent"), (1, "executing"), (1, "succeeded")]
    stage.wait(TIMEOUT_NS)
    assert stage.reports[-1] == (1, "idle")
    assert not stage.canceled()
    assert stage.action.is_quiet


@pytest.mark.parametrize(("state", "word"), [(CANCELED, "canceled"), (ABORTED, "aborted")])
def test_a_goal_that_ends_otherwise_is_not_sent_again(stage: Stage, state: int, word: str) -> None:
    stage.decide(1)
    stage.status((stage.answer(), state))
    stage.decide(1)
    stage.look()
    assert stage.sent() == [b"goal"]
    assert stage.look()["goal"] == [1, word]


def test_a_rejected_goal_is_not_sent_again(stage: Stage) -> None:
    stage.decide(1)
    stage.answer(accepted=False)
    stage.decide(1)
    assert stage.reports[-1] == (1, "rejected")
    assert stage.sent() == [b"goal"]
    assert stage.action.is_quiet


def test_a_goal_without_a_decision_is_canceled_after_the_timeout(stage: Stage) -> None:
    stage.decide(1)
    goal = stage.answer()
    stage.wait(TIMEOUT_NS - 1)
    assert not stage.canceled()
    stage.wait(1)
    assert stage.canceled() == [goal]
    assert stage.action.halt(stage.now_ns) == "walk: the goal is not canceled yet"
    stage.agree(goal)
    assert stage.action.halt(stage.now_ns) == ""


def test_a_cancellation_that_the_server_refuses_is_sent_again(stage: Stage) -> None:
    stage.decide(1)
    goal = stage.answer()
    stage.action.halt(stage.now_ns)
    stage.agree()
    assert stage.action.halt(stage.now_ns) == "walk: the goal is not canceled yet"
    stage.wait(CANCEL_AGAIN_NS)
    assert stage.canceled() == [goal] * 2


@pytest.mark.parametrize("is_agreed", [True, False])
def test_a_stop_is_acknowledged_as_soon_as_the_goal_is_canceled(stage: Stage, is_agreed: bool) -> None:
    stage.decide(1)
    goal = stage.answer()
    stage.action.stop_number = 7
    assert stage.action.halt(0)
    assert not stage.acknowledged
    if is_agreed:
        stage.agree(goal)
    stage.status((goal, CANCELED))
    assert stage.acknowledged == [7]


def test_a_cancellation_without_an_answer_is_sent_again(stage: Stage) -> None:
    stage.decide(1)
    goal = stage.answer()
    stage.action.halt(0)
    stage.wait(CANCEL_AGAIN_NS - 1)
    assert stage.canceled() == [goal]
    stage.wait(1)
    assert stage.canceled() == [goal] * 2
    stage.server.clients["cancel_goal"].requests[-1][1].answer(return_code=2)  # it is not known
    assert stage.action.is_quiet


def test_a_goal_that_is_accepted_after_it_went_away_is_canceled(stage: Stage) -> None:
    stage.decide(1)
    stage.action.halt(0)
    assert not stage.canceled()
    assert not stage.action.is_quiet
    assert stage.canceled() == [] != [stage.answer()]
    assert len(stage.canceled()) == 1


def test_the_end_of_an_earlier_goal_is_not_that_of_the_newest(stage: Stage) -> None:
    stage.decide(1, b"one")
    first = stage.answer()
    stage.status((first, EXECUTING))
    stage.decide(2, b"two")
    assert stage.reports[-1] == (2, "sent")
    stage.status((first, SUCCEEDED))
    assert stage.reports[-1] == (2, "sent")
    second = stage.answer()
    stage.status((first, ABORTED), (second, EXECUTING))
    assert stage.reports[-1] == (2, "executing")
    assert stage.sent() == [b"one", b"two"]


def test_a_replaced_goal_is_left_to_the_server_for_a_while_and_then_canceled(stage: Stage) -> None:
    stage.decide(1)
    first = stage.answer()
    stage.decide(2)
    stage.answer()
    stage.now_ns = PREEMPT_NS - 1
    stage.decide(2)
    stage.look()
    assert not stage.canceled()
    stage.now_ns = PREEMPT_NS
    stage.look()
    assert stage.canceled() == [first]


def test_a_replaced_goal_is_canceled_when_the_next_one_is_rejected(stage: Stage) -> None:
    stage.decide(1)
    first = stage.answer()
    stage.decide(2)
    stage.answer(accepted=False)
    assert stage.canceled() == [first]


def test_of_goals_that_change_while_one_is_sent_only_the_newest_follows(stage: Stage) -> None:
    for number in (1, 2, 3):
        stage.decide(number, b"goal %d" % number)
    stage.answer()
    assert stage.sent() == [b"goal 1", b"goal 3"]


def test_a_goal_of_a_bridge_that_was_killed_is_canceled_and_others_are_not(stage: Stage) -> None:
    before = Stage()
    before.decide(1)
    stray = before.answer()
    stage.status((stray, EXECUTING), (b"o" * 16, EXECUTING))
    assert stage.canceled() == [stray]
    stage.status((stray, CANCELED))
    assert stage.action.is_quiet


def test_a_lost_goal_is_sent_again_when_the_server_is_back_and_it_is_decided_still(stage: Stage) -> None:
    stage.decide(1)
    stage.status((stage.answer(), EXECUTING))
    stage.server.gids = []
    assert stage.look()["error"] == "no node serves /walk"
    assert stage.reports[-1] == (1, "lost")
    stage.decide(1)
    stage.server.gids = [b"second"]
    stage.look()
    assert stage.sent() == [b"goal"] * 2
    assert stage.reports[-1] == (1, "sent")
    stage.server.gids = []
    stage.look()
    stage.wait(TIMEOUT_NS)
    stage.server.gids = [b"third"]
    stage.look()
    assert stage.sent() == [b"goal"] * 2


def test_a_server_that_takes_the_place_of_a_killed_one_gets_the_goal(stage: Stage) -> None:
    stage.decide(1)
    stage.answer()
    stage.server.gids = [b"first", b"second"]  # the graph keeps the first one for a while
    stage.look()
    assert stage.sent() == [b"goal"] * 2
    assert [state for _, state in stage.reports[-2:]] == ["lost", "sent"]
    stage.server.gids = [b"second"]
    stage.look()
    assert stage.sent() == [b"goal"] * 2


def test_a_goal_that_the_server_knows_no_more_is_lost(stage: Stage) -> None:
    stage.decide(1)
    stage.status((stage.answer(), EXECUTING))
    stage.status((b"o" * 16, EXECUTING))
    assert [state for _, state in stage.reports[-2:]] == ["lost", "sent"]


def test_a_goal_without_an_answer_is_sent_again(stage: Stage) -> None:
    stage.decide(1)
    stage.now_ns = SEND_AGAIN_NS
    stage.decide(1)
    stage.look()
    assert stage.sent() == [b"goal"] * 2
    first, second = (r for r, _ in stage.server.clients["send_goal"].requests)
    stage.server.clients["send_goal"].requests[0][1].answer(accepted=True)
    assert stage.reports[-1] == (1, "sent")
    stage.answer()
    assert stage.reports[-1] == (1, "executing")
    assert first.goal_id.uuid != second.goal_id.uuid


def test_a_server_that_is_slow_to_accept_keeps_a_goal(stage: Stage) -> None:
    stage.decide(1)
    slow_ns, sent_ns = 5 * SEND_AGAIN_NS, [0]
    requests = stage.server.clients["send_goal"].requests
    while stage.reports[-1] != (1, "executing"):
        stage.now_ns += SEND_AGAIN_NS // 2
        assert stage.now_ns < 10 * slow_ns
        stage.decide(1)
        stage.look()
        sent_ns += [stage.now_ns] * (len(requests) - len(sent_ns))
        for (_, waiting), t_ns in zip(list(requests), sent_ns, strict=True):
            if stage.now_ns - t_ns == slow_ns:
                waiting.answer(accepted=True)
    assert len(requests) <= 4


def test_a_goal_that_the_type_cannot_have_is_rejected(
    stage: Stage, capsys: pytest.CaptureFixture[str]
) -> None:
    stage.decide(1, b"damaged")
    assert stage.reports[-1] == (1, "rejected")
    assert "walk: the goal cannot be sent: damaged" in capsys.readouterr().err
    assert stage.action.is_quiet


def test_a_goal_as_old_as_the_timeout_is_dropped(stage: Stage) -> None:
    stage.action.decide(0, NUMBER.pack(1) + b"goal", TIMEOUT_NS)
    assert not stage.sent()


def test_feedback_on_another_goal_is_not_forwarded(stage: Stage) -> None:
    heard: list[bytes] = []
    stage.action.forward = heard.append
    stage.decide(1)
    goal = stage.answer()
    stage.server.listens["feedback"](CDR + b"o" * 16 + b"other")
    stage.server.listens["feedback"](CDR + goal + b"ours")
    assert heard == [CDR + b"ours"]
    stage.decide(2)
    stage.server.listens["feedback"](CDR + goal + b"ours")
    assert heard == [CDR + b"ours"]


def test_an_action_without_its_type_says_so(stage: Stage) -> None:
    action = OutputAction({"topic": "walk", "type": "no_msgs/action/No", "timeout_ms": 250}, list, list, list)
    found = action.look(Server(), 0)
    assert found["error"] == "/walk: this ROS environment has no type `no_msgs/action/No`"
