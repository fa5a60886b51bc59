"""The input and output lines of `colony trace`: recorded frames, and decisions of an executor.

A frame is one JSON object per line, with `t` in seconds and readings in declared units. A sensor that is
absent or null is missing. Members about actuators are ignored, so that a recording is valid input.

If one of the first lines has a valid checksum, the input is a recording, and lines without a valid checksum
count as damaged and are skipped. A line with a wrong checksum is always skipped. Other bad lines are errors.
"""

from __future__ import annotations

import json
import re
import zlib
from codecs import BOM_UTF8
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from decimal import Decimal
from itertools import chain, islice
from typing import Any, BinaryIO, NamedTuple

import msgspec

from colony.files import bounded_lines
from colony.ir.frame import Decision, Frame, Outcome
from colony.ir.program import SENT, Program
from colony.ir.site import Site
from colony.ir.types import Array
from colony.ir.version import SEMANTICS, semantics_mismatch
from colony.runtime.recordings.json_text import lone_surrogate, parse_int, seconds_text
from colony.text.diagnostics import Diagnostic, DiagnosticError, error
from colony.text.source import Source, Span
from colony.text.units import nanoseconds
from colony.text.wording import did_you_mean

# --- replay --------------------------------------------------------------------------------------------


LINE_BYTES = 4 * 1024 * 1024
"""Byte limit of a line of a recording; no message of a robot, and so no frame, is larger."""

_MAX_EXACT_S = float(2**20)
"""Limit, in seconds, below which a double is within half a nanosecond of the decimal time it represents."""

_MAX_TIME_S = 9e9
"""Maximum time in seconds, almost 300 years, so that the time in nanoseconds fits into 64 bits."""


class RecordingLine(NamedTuple):
    """A line of a recording: its number, its text, its frame, and all members of its JSON object.

    `damaged` is True if lines just before it are damaged. `offset` is that of the line, in bytes from the
    first one.
    """

    number: int
    text: str
    frame: Frame
    values: Mapping[str, Any]
    damaged: bool = False
    offset: int = 0


class Rows:
    """The lines of a recording as rows; their members about actuators are not checked.

    `name` is the file's name in messages. `damaged` and `broken_off` are valid once all rows were read.

    Raises:
        DiagnosticError: during iteration, at the first bad line. Codes: F001 not JSON, F002 not an object,
            F003 no valid time, F004 time does not increase, F005 unknown sensor, F006 wrong length, F007 not
            text, F009 `restarted` is not a bool; A007 of another version of the semantics.
    """

    def __init__(self, lines: Iterable[bytes], name: str, program: Program) -> None:
        self._lines = lines
        self._parser = _RowParser(name, program)
        self.damaged = False
        """True if lines after the last row are damaged."""
        self.broken_off = False
        """True if the last line breaks off."""

    def __iter__(self) -> Iterator[RecordingLine]:
        """Yield the undamaged lines as rows."""
        remaining = enumerate(self._lines, 1)
        leading = tuple(islice(remaining, DETECTION_LINES))
        has_checksums = any(has_valid_checksum(line) for _, line in leading)
        end = 0
        for number, line in chain(leading, remaining):
            offset, end = end, end + len(line)
            damaged = (has_checksums or CHECKSUM_PREFIX in line) and not has_valid_checksum(line)
            if damaged and not line.endswith(b"\n") and _may_be_cut_off(line):
                self.broken_off = True
            elif damaged:
                self.damaged = True
            elif line.strip():
                yield self._parser.parse_row(number, line)._replace(damaged=self.damaged, offset=offset)
                self.damaged = False


CHECKSUM_PREFIX = b', "@sum": "'
"""First bytes of the checksum of a line."""

_CHECKSUM = re.compile(CHECKSUM_PREFIX + rb'([0-9a-f]{8})"\}\r?\n?')
_PARTIAL_CHECKSUM = re.compile(CHECKSUM_PREFIX + rb'([0-9a-f]{0,7}|[0-9a-f]{8}"?)')

DETECTION_LINES = 16
"""Number of leading lines of a recording, of which at least one must have a valid checksum."""


def _may_be_cut_off(line: bytes) -> bool:
    """Return True if an unterminated line may break off before or within its checksum."""
    start = line.rfind(CHECKSUM_PREFIX)
    return b"\0" not in line if start < 0 else _PARTIAL_CHECKSUM.fullmatch(line, start) is not None


def has_valid_checksum(line: bytes) -> bool:
    """Return True if a line ends with a valid checksum of its content."""
    start = line.rfind(CHECKSUM_PREFIX)
    match = _CHECKSUM.fullmatch(line, start) if start >= 0 else None
    return match is not None and int(match[1], 16) == zlib.crc32(line[:start].removeprefix(BOM_UTF8))


PARAMS = "@params"
"""Member of a line with the params that a site set."""

SHADOW = "@shadow"
"""Member of each line of a program in the shadow of a robot, which commanded nothing."""

RESERVED = frozenset(
    {
        *("t", "restarted"),
        *(
            "@tick",
            "@previous",
            "@semantics",
            "@restart",
            "@skipped",
            "@keyframe",
            "@python",
            PARAMS,
            SHADOW,
            "@heard",
            "@heard_broken",
            "@sum",
        ),
    }
)
"""Members of a line that are not sensors or actuators; names in a program cannot contain `@`."""


BAG_HINT = "of a bag, `colony shadow FILE --robot NAME --bag BAG --record OUT.mcap` makes a recording"

RECORD_AGAIN = "use the colony that recorded it, or record the run again"
"""Hint for recordings of another version of the semantics."""


class _RowParser:
    """The parser of lines, one after another. Stateful: remembers the time of the last line."""

    def __init__(self, name: str, program: Program) -> None:
        self._name = name
        self._sizes = {
            s.name: s.type.size if isinstance(s.type, Array) else None for s in program.robot.sensors
        }
        self._ignored = RESERVED.union(a.name for a in program.robot.actuators)
        self._last_ns: int | None = None

    def parse_row(self, number: int, data: bytes) -> RecordingLine:
        text = self._text(number, data)
        try:
            row = json.loads(text, object_pairs_hook=_reject_repeated_keys, parse_int=parse_int)
            surrogate = lone_surrogate(text, row)
        except _RepeatedKeyError as repeated:
            offset = self._offset(text, repeated.key, last=True)
            hint = "each line is a whole frame, each name once"
            message = f"`{repeated.key}` appears twice in one object"
            raise self._failure("F001", number, text, offset, message, hint) from None
        except json.JSONDecodeError as problem:
            message = f"not JSON: {problem.msg}"
            hint = "each line is a whole frame, an object in JSON"
            raise self._failure("F001", number, text, problem.pos, message, hint) from None
        except Exception as problem:
            is_deep = isinstance(problem, RecursionError)
            why = "it is nested too deeply" if is_deep else "a number has too many digits"
            raise self._failure("F001", number, text, 0, f"not readable JSON: {why}") from None
        if surrogate is not None:
            message = "not text: found half of a surrogate pair"
            raise self._failure("F001", number, text, surrogate, message)
        if not isinstance(row, dict):
            hint = 'a frame is an object: {"t": 0.05, "bumper": false}'
            message = f"a frame must be a JSON object, found {_kind(row)}"
            raise self._failure("F002", number, text, 0, message, hint)
        self._check_semantics(number, text, row)
        t_ns = self._time(number, text, row)
        readings = {key: row[key] for key in row if self._is_reading(number, text, row, key)}
        restarted = row.get("restarted", False)
        if not isinstance(restarted, bool):
            message = f'"restarted" must be true or false, found {_kind(restarted)}'
            raise self._failure("F009", number, text, self._offset(text, "restarted"), message)
        return RecordingLine(number, text, Frame(t_ns, readings, restarted=restarted), row)

    def _text(self, number: int, data: bytes) -> str:
        try:
            return data.decode("utf-8-sig" if number == 1 else "utf-8").rstrip("\r\n")
        except UnicodeDecodeError as problem:
            text = data[: problem.start].decode()
            message = f"not UTF-8 text: found byte 0x{data[problem.start]:02x}"
            raise self._failure("F007", number, text, len(text), message) from None

    def _check_semantics(self, number: int, text: str, row: dict[str, Any]) -> None:
        """Check the version of a recorded line; one with a `@tick` but no version is of version 1."""
        recorded = row.get("@semantics", 1 if "@tick" in row else SEMANTICS)
        if recorded != SEMANTICS:
            message = f"the recording {semantics_mismatch(recorded)}"
            offset = self._offset(text, "@semantics" if "@semantics" in row else "@tick")
            raise self._failure("A007", number, text, offset, message, RECORD_AGAIN)

    def _time(self, number: int, text: str, row: dict[str, Any]) -> int:
        t = row.get("t")
        if isinstance(t, bool) or not isinstance(t, int | float) or not abs(t) <= _MAX_TIME_S:
            found = "no time" if "t" not in row else json.dumps(t)
            found = found if len(found) <= 40 else f"{found[:37]}..."
            message = f'"t" must be the frame\'s time in seconds, found {found}'
            raise self._failure("F003", number, text, self._offset(text, "t"), message)
        if abs(t) < _MAX_EXACT_S:
            t_ns = nanoseconds(t)
        else:
            t_ns = round(Decimal(json.loads(text, parse_float=Decimal)["t"]) * 1_000_000_000)
        if self._last_ns is not None and t_ns <= self._last_ns:
            message = f"time must increase: {seconds_text(t_ns)} s follows {seconds_text(self._last_ns)} s"
            raise self._failure("F004", number, text, self._offset(text, "t"), message)
        self._last_ns = t_ns
        return t_ns

    def _is_reading(self, number: int, text: str, row: dict[str, Any], key: str) -> bool:
        """Return True if the key is a sensor; check the size of its value."""
        if key not in self._sizes and (key in self._ignored or key.startswith(f"{SENT}.")):
            return False
        if key not in self._sizes:
            hint = did_you_mean(key, self._sizes) or f"the robot has {', '.join(self._sizes)}"
            raise self._failure(
                "F005", number, text, self._offset(text, key), f"unknown sensor `{key}`", hint
            )
        size, value = self._sizes[key], row[key]
        if size is not None and isinstance(value, list) and len(value) != size:
            message = f"`{key}` must have {size} elements, found {len(value)}"
            hint = "write null if the sensor is missing"
            raise self._failure("F006", number, text, self._offset(text, key), message, hint)
        return True

    def _offset(self, text: str, key: str, *, last: bool = False) -> int:
        name = json.dumps(key)
        return max(text.rfind(name) if last else text.find(name), 0)

    def _failure(
        self, code: str, number: int, text: str, offset: int, message: str, hint: str | None = None
    ) -> DiagnosticError:
        return DiagnosticError([line_error(code, self._name, number, text, offset, message, hint)])


class _RepeatedKeyError(Exception):
    """A name appears twice in a JSON object, so that it is unknown which value is meant."""

    def __init__(self, key: str) -> None:
        self.key = key


def _reject_repeated_keys(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    row = dict(pairs)
    if len(row) < len(pairs):
        counts = Counter(name for name, _ in pairs)
        raise _RepeatedKeyError(next(name for name, count in counts.items() if count > 1))
    return row


def _kind(value: object) -> str:
    """Return the name of the type of a JSON value that is not an object."""
    match value:
        case None:
            return "null"
        case bool():
            return "true" if value else "false"
        case str():
            return "a text"
        case list():
            return "a list"
        case _:
            return "a number"


def line_error(
    code: str, name: str, number: int, text: str, offset: int, message: str, hint: str | None = None
) -> Diagnostic:
    """Return an error at a character of line `number` of the file `name`."""
    before = "\n" * (number - 1)
    start = len(before) + offset
    return error(code, Span(Source(name, before + text), start, start + 1), message, hint)


# --- decisions as lines ----------------------------------------------------------------------------


def outcome_line(program: Program, t_ns: int, outcome: Outcome) -> str:
    """Return the line `{"t": 0.05, "drive": {"by": "avoid", "velocity": 80.0}}`, without a line break.

    If no client commands, `by` is null and the values are those of the idle command; on `idle hold` the
    actuator is null.
    """
    fields = {a.name: [f.name for f in a.fields] for a in program.robot.actuators}
    parts = [f'"t": {seconds_text(t_ns)}']
    parts += [f"{json.dumps(d.actuator)}: {_decision(d, fields[d.actuator])}" for d in outcome.decisions]
    if outcome.breaches:
        parts.append(f'"breaches": {json.dumps(outcome.breaches)}')
    return "{" + ", ".join(parts) + "}"


def _decision(decision: Decision, fields: list[str]) -> str:
    if decision.values is None and decision.by is None:
        return "null"
    row: dict[str, object] = {"by": decision.by}
    row |= dict(zip(fields, decision.values or (), strict=decision.values is not None))
    if decision.fault is not None:
        row["fault"] = decision.fault
    return json.dumps(row)


# --- site ----------------------------------------------------------------------------------------------
#
# The params of a site in recordings: in the metadata of MCAP, in the lines with a keyframe of JSON lines.


_SEARCHED_LINES = 10_000
"""Maximum number of lines that are searched for a keyframe; every half second has one."""


class SiteMessage(msgspec.Struct, frozen=True, kw_only=True):
    """The params of a site, as a recording has them.

    `proved` are the contracts that were proved with these values, None for a run that needed no proof.
    """

    file: str
    hash: str
    values: dict[str, str]
    proved: tuple[str, ...] | None = None


def site_message(site: Site) -> SiteMessage:
    """Return the params of a site for a recording."""
    return SiteMessage(file=site.file, hash=site.hash, values=dict(site.values), proved=site.proved)


def site_text(site: Site) -> str:
    """Return the params of a site as JSON."""
    return json.dumps(msgspec.to_builtins(site_message(site)))


def read_site(message: Any) -> Site | None:
    """Return the params of a site; None if the message is absent.

    Raises:
        msgspec.ValidationError: the message is malformed, or its hash is not that of its values.
    """
    if message is None:
        return None
    found = msgspec.convert(message, SiteMessage)
    values = tuple(sorted(found.values.items()))
    site = Site(file=found.file, values=values, proved=found.proved)
    if site.hash != found.hash:
        raise msgspec.ValidationError("the params do not have their hash")
    return site


def site_of_lines(file: BinaryIO) -> Site | None:
    """Return the params in the first undamaged line with a keyframe; None if there are none.

    Raises:
        OSError: the file cannot be read.
    """
    for number, line in enumerate(bounded_lines(file, LINE_BYTES)):
        if number >= _SEARCHED_LINES:
            break
        if b'"@keyframe"' not in line or not has_valid_checksum(line):
            continue
        try:
            row = json.loads(line)
            return read_site(row.get(PARAMS)) if isinstance(row, Mapping) else None
        except Exception:  # malformed in any way
            continue
    return None
