"""The actions that the bridge commands: one goal at a time, sent when it changes, canceled when it goes away.

An action is two services and two topics below its name: `_action/send_goal`, `_action/cancel_goal`,
`_action/feedback` and `_action/status`. The bridge uses them directly: each goal keeps the id that it was
sent with, so that the end of an earlier goal is never that of a later one.

The first half of each id is the same for all goals of a node and an action. A goal of this half that is not
the current one is a stray: of a bridge that was killed, or one that the current goal has replaced. An action
server that preempts, as those of Nav2 do, ends a replaced goal by itself. Other strays are canceled.

The thread of the pipe notes what is decided; the executor's thread sends it. A goal without a fresh decision
for the timeout goes away, as does any goal when colony ends.
"""

from __future__ import annotations

import hashlib
import os
import struct
import sys
import threading
import time
from collections.abc import Callable
from typing import Any

from colony.ros2.bridge.topics import CDR, LATCHED, describe, interface, profile

OWNER_BYTES = 8
ID_BYTES = 16
PREEMPT_NS = 1_000_000_000
"""Time that a server has to end a goal that the current one has replaced, before it is canceled."""

CANCEL_AGAIN_NS = 500_000_000
SEND_AGAIN_NS = 3_000_000_000
"""Time without an answer after which a cancellation, or a goal, is sent again.

A goal waits twice as long each time, so that a server that is slow to accept goals keeps one.
"""

MAX_SEND_AGAIN_NS = 60_000_000_000

SENT, EXECUTING, REJECTED, LOST, IDLE = "sent", "executing", "rejected", "lost", "idle"
STATES = {1: EXECUTING, 2: EXECUTING, 3: EXECUTING, 4: "succeeded", 5: "canceled", 6: "aborted"}
"""The states of action_msgs/msg/GoalStatus: accepted, executing, canceling, and the three ends of a goal."""

UNKNOWN_GOAL, ENDED_GOAL = 2, 3
"""The answers to a cancellation of a goal that the server does not know, or that has ended."""

NUMBER = struct.Struct("<I")


class WantedGoal:
    """A goal that was decided: its number, and its message."""

    def __init__(self, number: int, message: bytes) -> None:
        self.number, self.message = number, message


class SentGoal:
    """The current goal: its id, once it was sent, and what is known of it."""

    def __init__(self, wanted: WantedGoal) -> None:
        self.wanted = wanted
        self.id = b""
        self.state = LOST
        self.patience_ns = SEND_AGAIN_NS
        self.accepted_ns: int | None = None
        self.is_listed = False  # it was in a message of the topic `status`

    def may_have_preempted(self, now_ns: int) -> bool:
        """Return True if the server had the time to end the goal before."""
        return self.accepted_ns is not None and now_ns - self.accepted_ns >= PREEMPT_NS

    @property
    def has_ended(self) -> bool:
        """True if nothing more comes of it."""
        return self.state not in (SENT, EXECUTING, LOST)


class OutputAction:
    """An action that colony commands.

    Args:
        settings: its name, type and timeout.
        wake: has the executor's thread call `step`.
        report: takes the number of the goal and its state whenever one of them changes.
        acknowledge: takes the number of a stop once the goals are canceled.
        clock: the monotonic clock in nanoseconds.
    """

    def __init__(
        self,
        settings: dict[str, Any],
        wake: Callable[[], Any],
        report: Callable[[int, str], Any],
        acknowledge: Callable[[int], Any],
        clock: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self.topic: str = settings["topic"]
        self.wanted: str = settings["type"]
        self.timeout_ns = int(1e6 * settings["timeout_ms"])
        self.error = f"{self.topic} is being discovered"
        self.decided_ns: int | None = None
        self.decided: WantedGoal | None = None
        self.goal: SentGoal | None = None
        self.open: dict[bytes, int | None] = {}  # goals that may run, and when their cancellation was sent
        self.canceling: set[bytes] = set()  # those whose cancellation was accepted
        self.sending = b""  # the id of the goal that has no answer yet, sent at `sent_ns`
        self.sent_ns = 0
        self.lock = threading.Lock()  # of `decided`, and of a goal that begins to be sent
        self.forward: Callable[[bytes], Any] = lambda data: None
        self.servers: set[bytes] = set()
        self.owner = b""
        self.stop_number: int | None = None  # of the last stop, until it is acknowledged
        self.wake, self.report, self.acknowledge, self.clock = wake, report, acknowledge, clock
        self.class_: Any = None
        self.send_client: Any = None
        self.cancel_client: Any = None

    # --- the thread of the pipe ---------------------------------------------------------------------

    def decide(self, decided_ns: int, payload: bytes, now_ns: int) -> None:
        """Note a decided goal, unless it is older than the timeout."""
        if now_ns - decided_ns < self.timeout_ns:
            self.decided_ns = decided_ns
            (number,) = NUMBER.unpack_from(payload)
            if self.decided is None or self.decided.number != number:
                self.decided = WantedGoal(number, payload[NUMBER.size :])
                self.wake()

    def halt(self, now_ns: int) -> str:
        """Have all goals canceled; return the reason why they are not canceled yet."""
        self.decided_ns = None
        with self.lock:
            self.decided = None
        self.wake()
        return "" if self.is_quiet else f"{self.topic}: the goal is not canceled yet"

    @property
    def is_quiet(self) -> bool:
        """True if the server knows no goal that runs, or has agreed to cancel it."""
        return all(goal_id in self.canceling for goal_id in list(self.open))

    def due_ns(self) -> int | None:
        """Return when `tick` has something to do; None if nothing is expected."""
        return None if self.decided_ns is None else self.decided_ns + self.timeout_ns

    def tick(self, now_ns: int) -> None:
        """Cancel the goal that is due."""
        due = self.due_ns()
        if due is not None and now_ns >= due:
            self.halt(now_ns)

    # --- the executor's thread ----------------------------------------------------------------------

    def look(self, node: Any, age_ns: int) -> dict[str, Any]:
        """Join the action; return what the graph shows of it, and the state of its goal."""
        name = node.resolve_topic_name(self.topic)
        try:
            self.join(node, name)
            self.judge(node, name)
        except Exception as problem:
            self.error = f"{name}: {problem}"
        self.step()
        goal = self.goal
        return {
            "name": name,
            "type": self.wanted,
            "error": self.error,
            "goal": [goal.wanted.number, goal.state] if goal else [0, IDLE],
        }

    def join(self, node: Any, name: str) -> None:
        """Create the clients and the subscriptions, once."""
        if self.cancel_client is not None:
            return
        self.class_ = interface(self.wanted)
        whole = f"{node.get_namespace()}/{node.get_name()} {name}"
        self.owner = hashlib.sha256(whole.encode()).digest()[:OWNER_BYTES]
        parts, below = self.class_.Impl, f"{self.topic}/_action/"
        self.send_client = node.create_client(parts.SendGoalService, below + "send_goal")
        node.create_subscription(
            parts.FeedbackMessage, below + "feedback", self.on_feedback, profile("reliable"), raw=True
        )
        node.create_subscription(parts.GoalStatusMessage, below + "status", self.on_status, profile(LATCHED))
        self.cancel_client = node.create_client(parts.CancelGoalService, below + "cancel_goal")

    def judge(self, node: Any, name: str) -> None:
        """Find out whether there is a server, and whether it is the one that has the goals."""
        ends = node.get_publishers_info_by_topic(f"{name}/_action/status")
        servers = {bytes(end.endpoint_gid) for end in ends}
        is_ready = self.send_client.service_is_ready() and self.cancel_client.service_is_ready()
        types = {each[2] for each in describe(ends)}
        self.error = "" if is_ready and types else f"no node serves {name}"
        if self.servers and (not is_ready or servers - self.servers):
            self.lose()
        self.servers = servers if is_ready else set()

    def lose(self) -> None:
        """Forget the goals of a server that has ended; the current one is sent to the next server."""
        self.open.clear()
        self.canceling.clear()
        self.sending = b""
        goal = self.goal
        if goal is not None and not goal.has_ended:
            goal.id, goal.is_listed = b"", False
            self.set_state(goal, LOST)

    def step(self) -> None:
        """Send the goal that is decided, and cancel the others."""
        decided, goal = self.decided, self.goal
        if decided is None:
            if goal is not None:
                self.goal = None
                self.report(goal.wanted.number, IDLE)
        elif goal is None or goal.wanted is not decided:
            goal = self.goal = SentGoal(decided)
            self.set_state(goal, LOST if self.error else SENT)
        if self.error:
            return
        patience_ns = goal.patience_ns if goal is not None and goal.id == self.sending else SEND_AGAIN_NS
        if self.sending and self.clock() - self.sent_ns >= patience_ns:
            unanswered, self.sending = self.sending, b""
            if goal is not None and goal.id == unanswered:
                goal.id, goal.patience_ns = b"", min(2 * goal.patience_ns, MAX_SEND_AGAIN_NS)
        goal = self.goal
        if goal is not None and not goal.id and not self.sending and not goal.has_ended:
            self.send(goal)
        self.cancel_strays()

    def send(self, goal: SentGoal) -> None:
        """Send a goal, unless it has gone away."""
        from rclpy.serialization import deserialize_message

        goal_id = self.owner + os.urandom(ID_BYTES - OWNER_BYTES)
        with self.lock:
            if goal.wanted is not self.decided:
                return
            self.open[goal_id] = None
        goal.id = self.sending = goal_id
        self.sent_ns = self.clock()
        request = self.class_.Impl.SendGoalService.Request()
        request.goal_id.uuid = list(goal_id)
        try:
            request.goal = deserialize_message(goal.wanted.message, self.class_.Goal)
            future = self.send_client.call_async(request)
        except Exception as problem:  # whatever rclpy and the middleware raise
            print(f"{self.topic}: the goal cannot be sent: {problem}", file=sys.stderr, flush=True)
            self.sending = b""
            self.forget(goal_id)
            self.set_state(goal, REJECTED)
            return
        self.set_state(goal, SENT)
        future.add_done_callback(lambda done: self.on_answer(goal_id, done))

    def on_answer(self, goal_id: bytes, future: Any) -> None:
        """Take the answer to a goal."""
        if goal_id != self.sending:  # it was sent again, or its server is lost
            return
        self.sending = b""
        is_accepted = future.exception() is None and future.result().accepted
        goal = self.goal
        if not is_accepted:
            self.forget(goal_id)
        if goal is not None and goal.id == goal_id:
            if is_accepted:
                goal.accepted_ns = self.clock()
            if not is_accepted or goal.state == SENT:
                self.set_state(goal, EXECUTING if is_accepted else REJECTED)
        self.step()

    def on_status(self, message: Any) -> None:
        """Take the states of the goals that the server knows."""
        states = {bytes(each.goal_info.goal_id.uuid): each.status for each in message.status_list}
        for goal_id, state in states.items():
            if goal_id[:OWNER_BYTES] == self.owner:
                if STATES.get(state) == EXECUTING:
                    self.open.setdefault(goal_id, None)
                else:
                    self.forget(goal_id)
        goal = self.goal
        if goal is not None and goal.id and not goal.has_ended:
            if goal.id in states:
                goal.is_listed = True
                self.set_state(goal, STATES.get(states[goal.id], goal.state))
            elif goal.is_listed:  # another server answers now
                self.lose()
        self.step()

    def on_feedback(self, data: bytes) -> None:
        """Forward the feedback on the current goal, without the id before it."""
        goal, begin = self.goal, len(CDR)
        if goal is not None and goal.id and data[begin : begin + ID_BYTES] == goal.id:
            self.forward(data[:begin] + data[begin + ID_BYTES :])

    def cancel_strays(self) -> None:
        """Cancel the goals that are not the current one, once the current one may replace them."""
        goal, now_ns = self.goal, self.clock()
        if goal is not None and not goal.has_ended and not goal.may_have_preempted(now_ns):
            return
        for goal_id, sent_ns in list(self.open.items()):
            is_current = goal is not None and goal.id == goal_id
            if is_current or goal_id == self.sending or goal_id in self.canceling:
                continue
            if sent_ns is None or now_ns - sent_ns >= CANCEL_AGAIN_NS:
                self.cancel(goal_id, now_ns)

    def cancel(self, goal_id: bytes, now_ns: int) -> None:
        """Send the cancellation of a goal."""
        request = self.class_.Impl.CancelGoalService.Request()
        request.goal_info.goal_id.uuid = list(goal_id)
        self.open[goal_id] = now_ns
        future = self.cancel_client.call_async(request)

        def answered(done: Any) -> None:
            if done.exception() is not None or goal_id not in self.open:
                return
            answer = done.result()
            if answer.return_code in (UNKNOWN_GOAL, ENDED_GOAL):
                self.forget(goal_id)
            elif goal_id in {bytes(each.goal_id.uuid) for each in answer.goals_canceling}:
                # the code alone does not say so: rclpy answers 0 as well where it refuses
                self.canceling.add(goal_id)
                self.note_quiet()

        future.add_done_callback(answered)

    def forget(self, goal_id: bytes) -> None:
        """Count a goal as one that has ended."""
        self.open.pop(goal_id, None)
        self.canceling.discard(goal_id)
        self.note_quiet()

    def note_quiet(self) -> None:
        """Acknowledge the last stop, if nothing is left to cancel."""
        number = self.stop_number
        if number is not None and self.is_quiet:
            self.stop_number = None
            self.acknowledge(number)

    def set_state(self, goal: SentGoal, state: str) -> None:
        """Set the state of the current goal, and report a new one."""
        if goal.state != state or state in (SENT, LOST):
            goal.state = state
            self.report(goal.wanted.number, state)
