"""Recordings: one JSON object a frame and line, which `colony trace --input` reads back.

    {"t": 0.05, "@tick": 1, "sonar": [...], "drive": {"by": "avoid", "velocity": 80.0}, "@sum": "8a4f01c2"}

`t` is in seconds and reads back to the same nanosecond; `@tick` is the number of the frame, `@restart` is
true where all memory began anew, and `@skipped` is there where memory is not known: the number of frames
before this one that could not be observed. Sensors are in declared units as they came from their servers,
and absent where missing; each actuator has its winner and what was sent. Where the network did not decide
alone, the actuator also has `fault`, `fates` with the clients that were late, lost, refused or overruled,
`@outside` with the client outside the network that commanded, or `@held_by`. Broken contracts are not
written: they follow from the rest. `@python` has what modules in Python answered (`answers.py`). `@sum` is
the CRC-32 of all before it, and `@keyframe`, in a line at least every half second, the memory from which a
reader goes on after a line that is damaged (`keyframes.py`).
`mcap_writer.py` writes more.
"""

from __future__ import annotations

import json
import zlib
from collections.abc import Callable
from typing import Protocol

from colony.execute.compiled import Compiled
from colony.ir.program import Actuator
from colony.runtime.observe.observer import FrameLog
from colony.runtime.protocol.messages import Verdict
from colony.runtime.recordings.answers import answers_text
from colony.runtime.recordings.json_text import seconds_text, sensor_members
from colony.runtime.recordings.keyframes import keyframe_members


class ByteFile(Protocol):
    """An unbuffered binary file."""

    def write(self, data: bytes, /) -> int | None: ...

    def close(self) -> None: ...


def write_all(file: ByteFile, data: bytes) -> None:
    """Write all of `data`, also where a full disk or a pipe takes a part at a time.

    Raises:
        OSError: it cannot be written.
    """
    while data:
        written = file.write(data)
        data = b"" if written is None else data[written:]


class Recording:
    """Writes each frame as it comes, a whole line in one write, so that a run that is killed at any moment
    leaves whole lines. A sink."""

    def __init__(self, compiled: Compiled, file: ByteFile) -> None:
        self._encode = encoder(compiled)
        self._file = file
        self.written_ns: int | None = None
        """Time of the last frame that is in the file."""

    def take(self, log: FrameLog) -> None:
        write_all(self._file, self._encode(log).encode() + b"\n")
        self.written_ns = log.frame.t_ns

    def close(self) -> None:
        self._file.close()


def encoder(compiled: Compiled) -> Callable[[FrameLog], str]:
    """How frames of a program are written: sensors, then actuators, in the order declared."""
    sensors = compiled.robot.sensors
    actuators = compiled.robot.actuators

    def encode(log: FrameLog) -> str:
        parts = [f'"t": {seconds_text(log.frame.t_ns)}', f'"@tick": {log.tick.k}']
        if log.restart:
            parts.append('"@restart": true')
        if log.memory_unknown:
            parts.append(f'"@skipped": {log.skipped}')
        if log.keyframe is not None:
            parts.append(f'"@keyframe": {{{", ".join(keyframe_members(log.keyframe))}}}')
        if log.answers:
            parts.append(f'"@python": {answers_text(log.answers)}')
        parts += sensor_members(log.frame, sensors)
        for actuator in actuators:
            verdict = log.verdicts.get(actuator.name)
            if verdict is not None:
                parts.append(f"{json.dumps(actuator.name)}: {_actuator(actuator, verdict)}")
        return summed("{" + ", ".join(parts))

    return encode


def summed(text: str) -> str:
    """Return an object of JSON, whose text lacks the brace that closes it, with its checksum at its end."""
    return f'{text}, "@sum": "{zlib.crc32(text.encode()):08x}"}}'


def _actuator(actuator: Actuator, verdict: Verdict) -> str:
    trouble = _trouble(verdict)
    if verdict.values is None:
        return json.dumps({"by": verdict.by, **trouble}) if verdict.by or trouble else "null"
    values = zip((f.name for f in actuator.fields), verdict.values, strict=True)
    return json.dumps({"by": verdict.by, **dict(values), **trouble})


_QUIET = frozenset({"won", "inactive", "silent", "suppressed", "inhibited"})


def _trouble(verdict: Verdict) -> dict[str, object]:
    out: dict[str, object] = {}
    if verdict.fault:
        out["fault"] = verdict.fault
    fates = {client: fate for client, fate in verdict.fates if fate not in _QUIET}
    if fates:
        out["fates"] = fates
    if verdict.outside is not None:
        out["@outside"] = verdict.outside
    if verdict.hold is not None:
        out["@held_by"] = verdict.hold
    return out
