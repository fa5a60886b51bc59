"""Recordings in JSON lines, one frame per line, which `colony trace --input` reads back.

    {"t": 0.05, "@tick": 1, "@semantics": 2, "sonar": [...], "drive": {"by": "avoid", "velocity": 80.0},
     "@sum": "8a4f01c2"}

`t` is in seconds and reads back to the same nanosecond; `@tick` is the number of the frame, `@semantics` the
version of what the program means (`colony.ir.version`), in each line because any line may be lost.
`@previous` is the number of the frame before this one, if a restarted Clock left numbers out between them.
`@restart` is true if all memory restarted, `restarted` is what the program reads of it, and `@skipped`,
present if memory is unknown, is the number of frames before this one that could not be observed. Sensors have
their published values in declared units, and are absent if missing; each actuator has its winner and the
command sent. If the network did not decide alone, the actuator also has `fault`, `fates` with the clients
that were late, lost, refused or overruled, `@outside` with the connection outside the network that commanded
(and `@unlimited` if the limits of the program did not hold for it), or `@held_by` with the reason of a hold.
Broken contracts are not written, because they follow from the rest. `@python` has the answers of modules in
Python (`json_text.py`). `@shadow` is true in each line of a program in the shadow of a robot, which sent
nothing. `@sum` is the CRC-32 of everything before it, and `@keyframe`, in a line at least every half second,
the memory from which a reader resumes after a damaged line (`json_text.py`). Beside it, `@params` has the
params that a site set (`site.py`). `@heard` has the commands of another controller by actuator, each with its
`@age_ns`, and `@heard_broken` the contracts that they broke.

MCAP recordings (`mcap_writer.py`) contain more.
"""

from __future__ import annotations

import json
import zlib
from collections.abc import Callable
from typing import Protocol

from colony.execute.compiled import Compiled
from colony.ir.program import Actuator
from colony.ir.version import SEMANTICS
from colony.runtime.frames.run_frame import RunFrame
from colony.runtime.protocol.messages import Verdict
from colony.runtime.recordings.json_text import answers_text, keyframe_members, seconds_text, sensor_members
from colony.runtime.recordings.replay import PARAMS, SHADOW, site_text


class ByteFile(Protocol):
    """An unbuffered binary file."""

    def write(self, data: bytes, /) -> int | None:
        """Write bytes; return the number written, or None."""
        ...

    def close(self) -> None:
        """Close the file."""
        ...


def write_all(file: ByteFile, data: bytes) -> None:
    """Write all of `data`, even if the file accepts only a part at a time, as a pipe does.

    Raises:
        OSError: the data cannot be written.
    """
    while data:
        written = file.write(data)
        data = b"" if written is None else data[written:]


class Recording:
    """A sink that writes each frame immediately, in one write, so that a killed run leaves whole lines."""

    def __init__(self, compiled: Compiled, file: ByteFile, *, shadow: bool = False) -> None:
        self._encode = encoder(compiled, shadow=shadow)
        self._file = file
        self.written_ns: int | None = None
        """Time of the last frame that is in the file."""

    def take(self, log: RunFrame) -> None:
        """Write the line of a frame."""
        write_all(self._file, self._encode(log).encode() + b"\n")
        self.written_ns = log.frame.t_ns

    def close(self) -> None:
        """Close the file."""
        self._file.close()


_SEMANTICS = f'"@semantics": {SEMANTICS}'


def encoder(compiled: Compiled, *, shadow: bool = False) -> Callable[[RunFrame], str]:
    """Return a function that encodes frames of a program: sensors, then actuators, in the order declared.

    With `shadow`, each says that nothing of it was sent.
    """
    sensors = compiled.robot.sensors
    actuators = compiled.robot.actuators
    site_members = [] if compiled.site is None else [f'"{PARAMS}": {site_text(compiled.site)}']

    def encode(log: RunFrame) -> str:
        parts = [f'"t": {seconds_text(log.frame.t_ns)}', f'"@tick": {log.tick.k}', _SEMANTICS]
        if shadow:
            parts.append(f'"{SHADOW}": true')
        if log.tick.previous != log.tick.k - 1:
            parts.append(f'"@previous": {log.tick.previous}')
        if log.frame.restarted:
            parts.append('"restarted": true')
        if log.restart:
            parts.append('"@restart": true')
        if log.memory_unknown:
            parts.append(f'"@skipped": {log.skipped}')
        if log.keyframe is not None:
            parts.append(f'"@keyframe": {{{", ".join(keyframe_members(log.keyframe))}}}')
            parts += site_members
        if log.answers:
            parts.append(f'"@python": {answers_text(log.answers)}')
        parts += sensor_members(log.frame, sensors)
        for actuator in actuators:
            verdict = log.verdicts.get(actuator.name)
            if verdict is not None:
                parts.append(f"{json.dumps(actuator.name)}: {_actuator(actuator, verdict)}")
        if log.heard:
            parts.append(
                f'"@heard": {json.dumps({a.name: _heard(a, log) for a in actuators if a.name in log.heard})}'
            )
        if log.heard_breaches:
            parts.append(f'"@heard_broken": {json.dumps(log.heard_breaches)}')
        return add_checksum("{" + ", ".join(parts))

    return encode


def add_checksum(text: str) -> str:
    """Return a JSON object, given without its closing brace, with its checksum as the last member."""
    return f'{text}, "@sum": "{zlib.crc32(text.encode()):08x}"}}'


def _actuator(actuator: Actuator, verdict: Verdict) -> str:
    deviations = _deviations(verdict)
    if verdict.values is None:
        return json.dumps({"by": verdict.by, **deviations}) if verdict.by or deviations else "null"
    values = zip((f.name for f in actuator.fields), verdict.values, strict=True)
    return json.dumps({"by": verdict.by, **dict(values), **deviations})


def _heard(actuator: Actuator, log: RunFrame) -> dict[str, float | bool] | None:
    command = log.heard[actuator.name]
    if command is None:
        return None
    values = zip((f.name for f in actuator.fields), command.values, strict=True)
    return {**dict(values), "@age_ns": command.age_ns}


_EXPECTED_FATES = frozenset({"won", "inactive", "silent", "suppressed", "inhibited"})


def _deviations(verdict: Verdict) -> dict[str, object]:
    members: dict[str, object] = {}
    if verdict.fault:
        members["fault"] = verdict.fault
    fates = {client: fate for client, fate in verdict.fates if fate not in _EXPECTED_FATES}
    if fates:
        members["fates"] = fates
    if verdict.outside is not None:
        members["@outside"] = verdict.outside
    if verdict.unlimited:
        members["@unlimited"] = True
    if verdict.hold is not None:
        members["@held_by"] = verdict.hold
    return members
