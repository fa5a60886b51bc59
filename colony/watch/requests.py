"""What a page asks for, checked as it comes in."""

from __future__ import annotations

from typing import Annotated

import msgspec

from colony.watch.marks import Mark

MAX_REQUEST_BYTES = 4096
"""Maximum size of a request of a page."""

_ALL_MARKS = int(Mark.WINNER | Mark.BREACH | Mark.FAULT | Mark.LATE | Mark.OUTSIDE | Mark.RESTART)

Name = Annotated[str, msgspec.Meta(max_length=1000)]


class _Request(msgspec.Struct, frozen=True, kw_only=True, tag_field="do", tag=str.lower):
    """A request; its name, in lower case, is the member `do`."""


class Play(_Request, frozen=True, kw_only=True):
    """Play from here at `speed` times the speed of the run."""

    speed: Annotated[float, msgspec.Meta(gt=0, le=1000)] = 1.0


class Pause(_Request, frozen=True, kw_only=True):
    """Stay at this frame."""


class Seek(_Request, frozen=True, kw_only=True):
    """Go to a time in seconds."""

    t: float


class Step(_Request, frozen=True, kw_only=True):
    """Go some frames forward, or back."""

    frames: Annotated[int, msgspec.Meta(ge=-10_000, le=10_000)]


class Jump(_Request, frozen=True, kw_only=True):
    """Go to the next frame in which something begins: a sum of `Mark`s."""

    kinds: Annotated[int, msgspec.Meta(ge=1, le=_ALL_MARKS)]
    backward: bool = False


class Follow(_Request, frozen=True, kw_only=True):
    """Follow the newest frame."""


class Ask(_Request, frozen=True, kw_only=True):
    """Ask why a module did, or did not, command in a frame."""

    module: Name
    k: int


class Stop(_Request, frozen=True, kw_only=True):
    """Stop the robot in an emergency."""


Request = Play | Pause | Seek | Step | Jump | Follow | Ask | Stop

_decoder: msgspec.json.Decoder[Request] = msgspec.json.Decoder(Request)


def read_request(text: str | bytes) -> Request:
    """Return a request.

    Raises:
        msgspec.MsgspecError: it is none.
    """
    return _decoder.decode(text)
