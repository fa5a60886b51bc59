"""What the server asks of the processes that analyze and prove, and their answers: messages on a pipe."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from typing import TypeVar

import msgspec
from msgspec import Struct

from colony.editing.index import EditorFinding, Index

_LENGTH = struct.Struct(">I")


class OpenProgram(Struct):
    """A program as it is open: the path of its file, the open texts by path, and the robot that was set."""

    path: str
    texts: dict[str, str]
    robot: str = ""


class AnalyzeJob(Struct, tag="analyze"):
    """Make the index of a program."""

    number: int
    program: OpenProgram


class UsesJob(Struct, tag="uses"):
    """Find every use of the name at `offset`, in the program and in the files of `folders`.

    With `new_name`, try it at all of these places.
    """

    number: int
    program: OpenProgram
    offset: int
    folders: list[str]
    new_name: str = ""


class FormatJob(Struct, tag="format"):
    """Format a text."""

    number: int
    path: str
    text: str


class ProveJob(Struct, tag="prove"):
    """Run the tests of a program, and prove its contracts; with `test`, run this one test alone."""

    number: int
    program: OpenProgram
    seconds: float
    test: str = ""


Job = AnalyzeJob | UsesJob | FormatJob | ProveJob


class AnalyzeAnswer(Struct, tag="analyzed"):
    """The index; `failed` is why there is none, which is a bug."""

    number: int
    index: Index
    failed: str = ""


class UsesAnswer(Struct, tag="used"):
    """Path, start and end of every use, with the text of each file; `refusal` is why there are none."""

    number: int
    kind: str
    name: str
    uses: list[tuple[str, int, int]]
    texts: dict[str, str]
    refusal: str = ""


class FormatAnswer(Struct, tag="formatted"):
    """The text in the one style, as it was if it has errors; `refusal` is why there is none."""

    number: int
    text: str
    refusal: str = ""


class ProofVerdict(Struct, tag="verdict"):
    """What was found about a contract or a test.

    Attributes:
        number: Number of the job.
        kind: `contract` (a reach, too) or `test`.
        name: Its name as declared in the file.
        word: The verdict in a word or two.
        is_bad: True if something has to be done about it.
        details: All that is known, as text.
        block: The test that repeats the run; "" if there is none.
    """

    number: int
    kind: str
    name: str
    word: str
    is_bad: bool
    details: str
    block: str = ""


class ProveAnswer(Struct, tag="done"):
    """All was proved or tried.

    Attributes:
        number: Number of the job.
        findings: What is wrong besides, such as what can never act.
        refusal: Why nothing was proved or tried; "" if it was.
        failed: The traceback of a bug.
    """

    number: int
    findings: list[EditorFinding] = []
    refusal: str = ""
    failed: str = ""


Answer = AnalyzeAnswer | UsesAnswer | FormatAnswer | ProofVerdict | ProveAnswer

_T = TypeVar("_T")


class Unpacking:
    """Takes bytes of a pipe, gives messages. Stateful: keeps the bytes of one that is not complete."""

    def __init__(self) -> None:
        self._bytes = bytearray()

    def feed(self, data: bytes, type_: type[_T]) -> Iterator[_T]:
        """Yield the complete messages so far."""
        self._bytes += data
        while len(self._bytes) >= _LENGTH.size:
            (length,) = _LENGTH.unpack_from(self._bytes)
            end = _LENGTH.size + length
            if len(self._bytes) < end:
                return
            body = bytes(self._bytes[_LENGTH.size : end])
            del self._bytes[:end]
            yield msgspec.msgpack.decode(body, type=type_)


def packed(message: object) -> bytes:
    """Return a message as bytes of a pipe."""
    body = msgspec.msgpack.encode(message)
    return _LENGTH.pack(len(body)) + body
