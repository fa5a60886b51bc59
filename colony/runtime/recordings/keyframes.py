"""Keyframes: snapshots of memory at least twice a second, from which a reader resumes after damage.

    {"memory": {"first_ns": 0, "cells": {"state bumps": 3.0, "window drive.0 until": 1750000000}}}

`memory` is the memory before the keyframe's frame, absent if unknown; `first_ns` is absent if memory is
initial. `last`, absent if empty, has what actuators were given last, for programs that read it. `degraded` is
true if a client has been lost since the epoch began. Numbers are written as in readings.
"""

from __future__ import annotations

import json
from typing import Literal

import msgspec

from colony.ir.memory import ProgramMemory
from colony.runtime.frames.run_frame import Keyframe
from colony.runtime.recordings.json_text import number_text


class _Memory(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    first_ns: int | None = None
    cells: dict[str, float | bool | int | Literal["nan"]]
    last: dict[str, float | bool] = {}


class _Keyframe(msgspec.Struct, frozen=True):
    memory: _Memory | None = None
    degraded: bool = False


def keyframe_members(keyframe: Keyframe) -> list[str]:
    """Return the members of a JSON object that holds the keyframe."""
    members = []
    if keyframe.memory is not None:
        first, cells = keyframe.memory.first_ns, keyframe.memory.cells
        texts = ", ".join([f"{json.dumps(name)}: {number_text(value)}" for name, value in cells.items()])
        first_member = "" if first is None else f'"first_ns": {first}, '
        sent = ", ".join([f"{json.dumps(n)}: {number_text(x)}" for n, x in keyframe.memory.last.items()])
        last_member = f', "last": {{{sent}}}' if sent else ""
        members.append(f'"memory": {{{first_member}"cells": {{{texts}}}{last_member}}}')
    if keyframe.degraded:
        members.append('"degraded": true')
    return members


def read_keyframe(value: object) -> Keyframe | None:
    """Return the keyframe in a JSON value, None for None; a malformed keyframe has unknown memory."""
    if value is None:
        return None
    try:
        keyframe = msgspec.convert(value, _Keyframe)
    except Exception:  # malformed in any way
        return Keyframe(None)
    memory = keyframe.memory
    if memory is None:
        return Keyframe(None, keyframe.degraded)
    cells = {name: float(x) if isinstance(x, str) else x for name, x in memory.cells.items()}
    return Keyframe(ProgramMemory(first_ns=memory.first_ns, cells=cells, last=memory.last), keyframe.degraded)
