"""The topics and actions of a connection: what the bridge is asked for, and what it reports of them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

from colony.ir.ros2_messages import AUTO, TWIST
from colony.ros2.graph import heard_problems, sent_problems
from colony.ros2.incoming import Incoming


class HeardTopic:
    """A topic that is heard. Mutable: has what the bridge reports of it."""

    def __init__(self, incoming: Incoming, type_: str, quality: str) -> None:
        self.incoming, self.type, self.quality = incoming, type_, quality
        self.problems: tuple[str, ...] = ()

    def take(self, seen: Mapping[str, Any], *, is_settled: bool) -> None:
        """Take what the bridge reports of it."""
        type_ = (seen["type"] or TWIST) if self.type == AUTO else self.type
        self.problems = tuple(heard_problems(seen, type_, self.quality)) if is_settled else ()

    @property
    def problem(self) -> str | None:
        """Why nothing usable arrives, or None."""
        return next(iter(self.problems), None) or self.incoming.fault

    def settings(self) -> Mapping[str, Any]:
        """Return what the bridge needs to subscribe."""
        return {"topic": self.incoming.topic, "type": self.type, "qos": self.quality}


class CommandedTopic:
    """A topic that is commanded. Mutable: has what the bridge reports of it, and whether its stop arrived.

    Args:
        topic: its name.
        type_: its type, or `auto` for the one of the two twists that the subscribers expect.
        is_stopped: True if a message of zeros is its stop; False if it stays as it was commanded last.
        timeout_ns: the time without a decision after which the bridge stops.
        quality: the quality of service, `reliable`, `best_effort` or `latched`.
        alone: True to refuse to begin beside another publisher.
        frame: the frame of stamped messages.
    """

    def __init__(
        self,
        topic: str,
        type_: str,
        *,
        is_stopped: bool,
        timeout_ns: int,
        quality: str = "reliable",
        alone: bool = False,
        frame: str = "",
    ) -> None:
        self.topic, self.quality = topic, quality
        self._settings = {
            "topic": topic,
            "type": type_,
            "qos": quality,
            "stop": is_stopped,
            "timeout_ms": timeout_ns / 1e6,
            "alone": alone,
            "frame": frame,
        }
        self.number = 0
        self.unreached: str | None = None
        self.problems: tuple[str, ...]
        self.asked_s: float | None  # while an answer is due
        self.forget()

    def forget(self) -> None:
        """Forget what a bridge that ends has reported."""
        self.problems, self.asked_s, self.retry_s = (), None, 0.0
        self.error = f"{self.topic} is being discovered"

    def take(self, seen: Mapping[str, Any], *, is_settled: bool) -> None:
        """Take what the bridge reports of it."""
        self.error = seen["error"]
        self.problems = tuple(sent_problems(seen, self.quality)) if is_settled else ()

    @property
    def refusal(self) -> str:
        """Why nothing can be decided now; "" if it can."""
        return self.error

    @property
    def problem(self) -> str | None:
        """Why commands do not arrive, or not ours alone; None if they do."""
        return "; ".join(self.problems) or None

    def settings(self) -> Mapping[str, Any]:
        """Return what the bridge needs to publish."""
        return self._settings


class GoalState(NamedTuple):
    """The state of the goal of a number, in the words of ROS 2: `sent`, `executing`, `succeeded`, ..."""

    number: int
    state: str


class CommandedAction(CommandedTopic):
    """An action that is commanded. Mutable: has the state of its goal, and the feedback on it.

    Args:
        topic: its name.
        type_: its type.
        timeout_ns: the time without a decision after which the bridge cancels the goal.
        feedback: the feedback on the current goal.
    """

    def __init__(self, topic: str, type_: str, *, timeout_ns: int, feedback: HeardTopic) -> None:
        self.goal: GoalState | None = None
        self.feedback = feedback
        super().__init__(topic, type_, is_stopped=True, timeout_ns=timeout_ns)

    def forget(self) -> None:
        """Forget what a bridge that ends has reported, and the goal that it canceled."""
        super().forget()
        self.goal = None

    def take(self, seen: Mapping[str, Any], *, is_settled: bool) -> None:
        """Take what the bridge reports of it."""
        self.error = seen["error"]
        self.problems = (self.error,) if self.error and is_settled else ()
        self.note(GoalState(*seen["goal"]))

    def note(self, goal: GoalState) -> None:
        """Take the state of its goal; the feedback on another one is over."""
        if self.goal is None or goal.number != self.goal.number or goal.state in ("idle", "sent"):
            self.feedback.incoming.put(None)
        self.goal = goal

    @property
    def refusal(self) -> str:
        """Why nothing can be decided now: never, as the bridge keeps the goal until there is a server."""
        return ""
