"""Zenoh keys of topics, and the information that a key contains about its message.

    Clock/ticks                 colony/rome/Clock/ticks
    RServer/reply/ada/7         colony/rome/RServer/reply/ada/7
    RServer/call                colony/rome/RServer/call/<right>/ada/7
    RServer/fetches             colony/rome/RServer/fetches/ada

The key of a call contains its right and its connection, and the keys of all other messages from clients
contain the user, because zenoh's access control restricts users only by key. A message must agree with its
key. For the same reason each topic accepts only its own kinds of messages: a user who may only fetch frames
must not be able to send a call there.
"""

from __future__ import annotations

from typing import NamedTuple, get_args

from colony.runtime.protocol.codec import MessageFormatError
from colony.runtime.protocol.messages import (
    Alive,
    Announcement,
    Bounds,
    Call,
    Checkpoint,
    Fetch,
    Notice,
    Ready,
    Recall,
    Reply,
    Request,
    Restart,
    Right,
    SentMessage,
    ServerFrame,
    Tick,
    Verdict,
    WireMessage,
)

RIGHTS: tuple[Right, ...] = get_args(Right)
_CALL = "/call"

_KINDS: dict[str, tuple[type, ...]] = {
    "ticks": (Tick,),
    "frames": (ServerFrame, Tick),
    "answers": (ServerFrame,),
    "activity": (ServerFrame,),
    "fetches": (Fetch,),
    "requests": (Request, Bounds),
    "announcements": (Announcement,),
    "checkpoints": (Checkpoint, Recall),
    "recalled": (Checkpoint,),
    "repeats": (Fetch,),
    "ready": (Ready,),
    "restarts": (Restart,),
    "verdicts": (Verdict,),
    "reply": (Reply, Notice),
}
"""The message types accepted on a topic, by the topic's second part (or its only part)."""


_USER_MESSAGE_KINDS = frozenset({"fetches", "requests", "announcements", "checkpoints", "ready", "restarts"})
"""Kinds of messages other than calls that clients send to servers, as the second part of the topic."""


class CallKey(NamedTuple):
    """The right and the connection in the key of a call."""

    right: Right
    connection: str


def prefix(robot: str) -> str:
    """Return the prefix of a robot's keys."""
    return f"colony/{robot}/"


def carries_calls(topic: str) -> bool:
    """Return True if a topic carries calls."""
    return topic.endswith(_CALL)


def carries_memory(topic: str) -> bool:
    """Return True if a topic carries the memory of clients, which may be large."""
    _, _, kind = topic.partition("/")
    return kind == "checkpoints" or kind.startswith("recalled/")


def user_message_kind(topic: str) -> str | None:
    """Return the kind of messages on a topic if their keys contain the user, else None."""
    _, _, kind = topic.partition("/")
    return kind if kind in _USER_MESSAGE_KINDS else None


def subscription_key(robot: str, topic: str) -> str:
    """Return the key expression to subscribe to for a topic."""
    if carries_calls(topic):
        return f"colony/{robot}/{topic}/*/*/*"
    return f"colony/{robot}/{topic}" + ("/*" if user_message_kind(topic) else "")


def call_subscription_key(robot: str, topic: str, right: Right) -> str:
    """Return the key expression of the calls on a topic that are made with one right."""
    return f"colony/{robot}/{topic}/{right}/*/*"


def publication_key(
    robot: str, topic: str, message: WireMessage, *, user: str, alive_right: Right = "read"
) -> str:
    """Return the key on which `user` sends a message to a topic.

    A keepalive uses `alive_right`, which may be any right of its sender.
    """
    match message:
        case Call(right=right, connection=connection):
            return f"colony/{robot}/{topic}/{right}/{connection}"
        case Alive(connection=connection):
            return f"colony/{robot}/{topic}/{alive_right}/{connection}"
        case _:
            return f"colony/{robot}/{topic}" + (f"/{user}" if user_message_kind(topic) else "")


def replies_to_process(robot: str, user: str, bucket: str) -> str:
    """Return the key expression of the replies to all connections of a process.

    The ids of these connections begin with `bucket`.
    """
    return f"colony/{robot}/*/reply/{user}/{bucket}-$*"


def liveliness_key(robot: str, address: str) -> str:
    """Return the key of a node's liveliness token."""
    return f"colony/{robot}/alive/{address}"


def call_key(key: str) -> CallKey | None:
    """Parse the key of a call; return None if it is not one."""
    parts = key.rsplit("/", 3)
    if len(parts) != 4:
        return None
    for right in RIGHTS:
        if parts[1] == right:
            return CallKey(right, f"{parts[2]}/{parts[3]}")
    return None


def check_call(message: SentMessage, key: CallKey) -> Call | Alive:
    """Return the message if it is valid on this key.

    Raises:
        MessageFormatError: it is not a call or keepalive, or claims another connection or right.
    """
    match message:
        case Call(right=right, connection=connection):
            if right != key.right:
                raise MessageFormatError(
                    f"it claims the right to {right}, but arrived with the right to {key.right}"
                )
        case Alive(connection=connection):
            pass
        case _:
            raise MessageFormatError(f"found {type(message).__name__}; expected Call or Alive")
    if connection != key.connection:
        raise MessageFormatError(f"it claims the connection {connection}, but is from {key.connection}")
    return message


def check_frame(message: SentMessage, topic: str) -> SentMessage:
    """Return the message if it is valid on this topic, which does not carry calls.

    Raises:
        MessageFormatError: it belongs on another topic.
    """
    parts = topic.split("/", 2)
    kinds = _KINDS.get(parts[min(1, len(parts) - 1)])
    if isinstance(message, (Call, Alive)) or (kinds is not None and not isinstance(message, kinds)):
        expected = "no call" if kinds is None else " or ".join(kind.__name__ for kind in kinds)
        raise MessageFormatError(f"found {type(message).__name__}; expected {expected}")
    return message
