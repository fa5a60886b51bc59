"""What is heard of a robot while it is tested: ticks and verdicts, and what follows from them."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator, Mapping, Sequence, Set
from dataclasses import dataclass, field
from itertools import pairwise

from colony.runtime.protocol import topics
from colony.runtime.protocol.deployment import LIMITS_RUN
from colony.runtime.protocol.messages import UNHEARD, Effect, Message, QuietNode, Tick, Verdict

STREAK = 3
"""Number of undisturbed frames in a row by which a robot has recovered."""

MOST_FRAMES = 4000
"""Maximum number of frames that are kept: more than those of the longest step."""


@dataclass(frozen=False, slots=True, kw_only=True)
class HeardFrame:
    """One frame: its tick, the verdict on each actuator, and the time at which the last of these came."""

    tick: Tick
    verdicts: dict[str, Verdict] = field(default_factory=dict)
    heard_ns: int = 0

    def take(self, verdict: Verdict, now_ns: int) -> None:
        """Add a verdict; that of an actuator that is idle in any case may come before the tick."""
        self.verdicts[verdict.actuator], self.heard_ns = verdict, now_ns


class VerdictListener(QuietNode):
    """A node that hears all ticks and verdicts and sends nothing. Mutable.

    A thread of its host hands it messages; all else belongs to the thread that calls `poll`.
    """

    address = "Acceptance"
    listens = (topics.TICKS, topics.VERDICTS)

    def __init__(self) -> None:
        self._inbox: deque[tuple[int, Message]] = deque()
        self._frames: dict[int, HeardFrame] = {}
        self._early: dict[int, list[tuple[int, Verdict]]] = {}

    def handle(self, message: Message, now_ns: int) -> Iterable[Effect]:
        """Keep a message with the time at which it came."""
        self._inbox.append((now_ns, message))
        return ()

    def poll(self) -> None:
        """Sort what came since the last call into frames."""
        while self._inbox:
            now_ns, message = self._inbox.popleft()
            if isinstance(message, Tick):
                self._frames[message.k] = frame = HeardFrame(tick=message)
                for heard_ns, verdict in self._early.pop(message.k, ()):
                    frame.take(verdict, heard_ns)
            elif isinstance(message, Verdict) and message.k in self._frames:
                self._frames[message.k].take(message, now_ns)
            elif isinstance(message, Verdict):
                self._early.setdefault(message.k, []).append((now_ns, message))
        for kept in (self._frames, self._early):
            while len(kept) > MOST_FRAMES:
                del kept[next(iter(kept))]

    def since(self, t_ns: int) -> list[HeardFrame]:
        """Return the frames that began at this time of the robot or later."""
        newer: list[HeardFrame] = []
        for frame in reversed(self._frames.values()):
            if frame.tick.t_ns < t_ns:
                break
            newer.append(frame)
        return newer[::-1]


def disturbances(frame: HeardFrame, actuators: Set[str], absent: Set[str]) -> Iterator[str]:
    """Yield what is missing in a frame; nothing if every server and every client had its part in it.

    Args:
        frame: the frame.
        actuators: the actuators of the program.
        absent: servers that nobody serves.
    """
    if frame.tick.run in ("", LIMITS_RUN):
        yield "the behavior does not run"
    yield from (f"{server} is down" for server in frame.tick.down if server not in absent)
    yield from (f"{client} is lost" for client in frame.tick.lost)
    for actuator in sorted(actuators):
        verdict = frame.verdicts.get(actuator)
        if verdict is None:
            yield f"no verdict on {actuator}"
            continue
        yield from (f"{client} is {fate}" for client, fate in verdict.fates if fate in UNHEARD)
        if verdict.violation:
            yield f"two clients command {actuator}"


def recovered_ns(
    frames: Sequence[HeardFrame], actuators: Set[str], absent: Set[str], *, driven: bool = False
) -> int | None:
    """Return when the first of three undisturbed frames in a row was decided; None if there are none yet.

    With `driven`, the network has to decide them: no emergency stop or lock is in force.
    """
    streak: list[HeardFrame] = []
    for frame in frames:
        is_held = driven and any(verdict.hold is not None for verdict in frame.verdicts.values())
        is_disturbed = is_held or any(True for _ in disturbances(frame, actuators, absent))
        streak = [] if is_disturbed else [*streak, frame]
        if len(streak) == STREAK:
            return streak[0].heard_ns
    return None


def stopped_ns(frames: Iterable[HeardFrame], actuators: Set[str], pressed_ns: int) -> int | None:
    """Return when the first frame was decided in which the emergency stop held every actuator."""
    for frame in frames:
        if frame.heard_ns >= pressed_ns and all(_is_stopped(frame.verdicts, name) for name in actuators):
            return frame.heard_ns
    return None


def slip(frames: Iterable[HeardFrame], stopped_ns: int) -> tuple[int, str] | None:
    """Return the first command that was sent in spite of an emergency stop in force: its time, and whose."""
    for frame in frames:
        for actuator, verdict in frame.verdicts.items():
            if frame.heard_ns > stopped_ns and not _is_stopped(frame.verdicts, actuator):
                return frame.tick.t_ns, f"{actuator} by {verdict.by or verdict.outside or 'nobody'}"
    return None


def _is_stopped(verdicts: Mapping[str, Verdict], actuator: str) -> bool:
    verdict = verdicts.get(actuator)
    return verdict is not None and verdict.hold == "stopped"


Speeds = tuple[float, ...]
"""Velocity in mm/s, turning speed in deg/s and sideways velocity in mm/s of a base."""


def brakes_ns(samples: Sequence[tuple[int, Speeds]], since_ns: int, until_ns: int) -> int:
    """Return how long after a time the base was moving and did not brake, or did not brake all the time.

    Args:
        samples: times and speeds, in order.
        since_ns: the time.
        until_ns: the time at which it is commanded again.
    """
    kept = [
        t_ns - since_ns
        for (before_ns, before), (t_ns, speeds) in pairwise(samples)
        if before_ns < t_ns and since_ns < t_ns < until_ns
        if any(now and abs(now) >= abs(then) for then, now in zip(before, speeds, strict=True))
    ]
    return max(kept, default=0)
