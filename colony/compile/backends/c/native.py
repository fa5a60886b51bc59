"""Generated C on this computer: compiled once, cached by content, and stepped as an executor."""

from __future__ import annotations

import os
import re
import shlex
import shutil
import subprocess
import sys
import sysconfig
import tempfile
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from functools import cache
from hashlib import sha256
from importlib.util import module_from_spec, spec_from_file_location
from operator import attrgetter
from pathlib import Path
from typing import Any

from colony.compile.backends.c.expressions import identifier
from colony.compile.backends.c.generate import CText, generate_c
from colony.execute.checked import checked_frame
from colony.execute.compiled import Compiled
from colony.execute.intake import as_float
from colony.extras import expect_extras, installed
from colony.files import keep_in_cache, read_from_cache, user_cache
from colony.ir.frame import Decision, Frame, FrameEvent, Outcome, RecordKind
from colony.ir.program import Actuator, Sensor
from colony.ir.types import Array, Bool, element_type

STRICT = ("-std=c99", "-ffp-contract=off", "-O2")
"""Options of the compiler that keep arithmetic that of IEEE 754."""

COMPILE_SECONDS = 600.0
"""Timeout in seconds of the C compiler."""

_MAX_BYTES = 256 * 1024 * 1024

_ABSENT, _GIVEN, _FAULTY, _LOST = range(4)
_REASONS: Sequence[RecordKind | None] = (None, "missing", "not finite", "bound missing", "limits contradict")
_CHANGES: Mapping[int, RecordKind] = {1: "limited", 2: "command clamped"}
_FOUND: Mapping[int, RecordKind] = {2: "sensor clamped", 3: "sensor fault"}


class NoCompilerError(Exception):
    """C cannot be compiled here; the message has the reason in one line."""


def compiler() -> tuple[str, ...]:
    """Return the command of the C compiler: `$CC`, else the first of cc, gcc and clang.

    Raises:
        NoCompilerError: there is none.
    """
    chosen = shlex.split(os.environ.get("CC", ""))
    names = [chosen[0]] if chosen else ["cc", "gcc", "clang"]
    found = next((path for name in names if (path := shutil.which(name))), None)
    if found is None:
        raise NoCompilerError(f"no C compiler ({' or '.join(names)})")
    return (found, *chosen[1:])


def is_available() -> bool:
    """Return True if C can be compiled and loaded here."""
    try:
        compiler()
    except NoCompilerError:
        return False
    return installed("cffi")


def load_c(compiled: Compiled) -> CExecutor:
    """Return an executor of a program in C; see `built`.

    Raises:
        DiagnosticError: C002, it has a module in Python.
        MissingExtraError: cffi is not installed.
        NoCompilerError: there is no C compiler, or it failed.
    """
    text = generate_c(compiled)
    return CExecutor(text, built(text))


def built(text: CText, command: Sequence[str] = (), options: Sequence[str] = STRICT) -> Any:
    """Compile a program in C for this computer, or load what was compiled before.

    Args:
        text: The program.
        command: The C compiler, by default that of `compiler`.
        options: The options of the compiler.

    Returns:
        The module that cffi makes of it.

    Raises:
        MissingExtraError: cffi is not installed.
        NoCompilerError: there is no C compiler, or it failed.
    """
    expect_extras("native")
    command = tuple(command) or compiler()
    from cffi import FFI, __version__
    from cffi.recompiler import make_c_source

    about = [text.header, text.source, *_version(command), *options, __version__, sys.version, sys.executable]
    name = "_colony_" + sha256(repr(about).encode()).hexdigest()[:32]
    file = user_cache(os.environ, f"native/{name}{sysconfig.get_config_var('EXT_SUFFIX')}")
    with tempfile.TemporaryDirectory() as folder:
        target = Path(folder) / f"{name}.so"
        kept = _kept(file)
        if kept:
            target.write_bytes(kept)
            return _imported(name, target)
        ffi = FFI()
        ffi.cdef(re.sub(r"^#.*\n", "", text.header, flags=re.MULTILINE))
        include = f'#include "{text.name}.h"\n'
        make_c_source(ffi, name, text.header + text.source.replace(include, "", 1), f"{folder}/{name}.c")
        _run([*command, *options, *_shared(), f"{folder}/{name}.c", "-o", str(target), "-lm"])
        if file is not None:
            with suppress(OSError):  # then it is compiled again next time
                data = target.read_bytes()
                keep_in_cache(file, sha256(data).digest() + data)
        return _imported(name, target)


def _shared() -> list[str]:
    apart = ["-undefined", "dynamic_lookup"] if sys.platform == "darwin" else []
    return ["-shared", "-fPIC", *apart, f"-I{sysconfig.get_paths()['include']}"]


@cache
def _version(command: tuple[str, ...]) -> tuple[str, ...]:
    return (*command, _run([*command, "--version"]))


def _run(arguments: Sequence[str]) -> str:
    try:
        done = subprocess.run(
            arguments, capture_output=True, text=True, errors="replace", timeout=COMPILE_SECONDS, check=False
        )
    except (OSError, subprocess.TimeoutExpired) as problem:
        raise NoCompilerError(f"{arguments[0]}: {problem}") from None
    if done.returncode != 0:
        [line, *_] = [*(x for x in done.stderr.splitlines() if "error" in x), f"exit code {done.returncode}"]
        raise NoCompilerError(f"{arguments[0]}: {line}")
    return done.stdout


def _kept(file: Path | None) -> bytes:
    """Return what a file of the cache has after its digest; nothing if it is damaged or not there."""
    try:
        kept = read_from_cache(file, _MAX_BYTES) if file is not None else b""
    except OSError:
        return b""
    return kept[32:] if sha256(kept[32:]).digest() == kept[:32] else b""


def _imported(name: str, path: Path) -> Any:
    spec = spec_from_file_location(name, path)
    assert spec is not None
    assert spec.loader is not None
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


# --- the executor -------------------------------------------------------------------------------------

_Take = Callable[[Mapping[str, Any], int, Mapping[str, int]], None]
"""A function that writes a sensor's reading into the frame, given readings, the time, and their times."""


class CExecutor:
    """An executor of a program compiled to C (see `ir.frame.Executor`). Stateful: it holds all memory.

    `frame` is the struct that `write` fills, as cffi shows it.
    """

    def __init__(self, text: CText, module: Any) -> None:
        """Take the module that `built` returned for the text."""
        ffi, lib, p = module.ffi, module.lib, text.name
        self._init, self._step = getattr(lib, f"{p}_init"), getattr(lib, f"{p}_step")
        structs = (ffi.new(f"struct {p}_{x} *") for x in ("memory", "frame", "outcome"))
        self._memory, self.frame, self._out = structs
        code = text.compiled.code
        self._sensors = code.sensors
        self._takes = [
            _take(sensor, getattr(self.frame, member))
            for sensor, member in zip(code.sensors, text.sensors, strict=True)
        ]
        self._found = ffi.buffer(self._out.found) if code.sensors else b""
        self._broken = ffi.buffer(self._out.broken) if code.contracts else b""
        self._contracts = tuple(c.name for c in code.contracts)
        self._decisions = [
            _decision(actuator.actuator, getattr(self._out, member), (None, *text.modules), ffi)
            for actuator, member in zip(code.actuators, text.actuators, strict=True)
        ]
        self.restart()

    def write(self, frame: Frame) -> None:
        """Write a frame into the struct that the next step reads."""
        t_ns, readings, taken_ns, restarted = frame
        self.frame.t_ns, self.frame.restarted = t_ns, restarted
        for take in self._takes:
            take(readings, t_ns, taken_ns)

    def step(self, frame: Frame) -> Outcome:
        """Execute one frame."""
        self.write(frame)
        self._step(self._memory, self.frame, self._out)
        records: list[FrameEvent] = []
        found = bytes(self._found)
        if found.translate(None, b"\0\1"):
            pairs = zip(found, self._sensors, strict=True)
            records += [FrameEvent(_FOUND[x], sensor.name) for x, sensor in pairs if x > 1]
        decisions = tuple([decide(records) for decide in self._decisions])
        broken = bytes(self._broken)
        breaches: tuple[str, ...] = ()
        if 1 in broken:
            breaches = tuple([name for x, name in zip(broken, self._contracts, strict=True) if x])
        return Outcome(decisions, tuple(records), breaches)

    def restart(self) -> None:
        """Restart from the initial memory."""
        self._init(self._memory)


class CheckedCExecutor(CExecutor):
    """An executor of a program compiled to C that refuses invalid frames."""

    _last_ns: int | None = None

    def step(self, frame: Frame) -> Outcome:
        """Execute one frame and return its outcome.

        Raises:
            TypeError, ValueError: it is no valid frame (see `colony.execute.checked`).
        """
        checked = checked_frame(frame, self._last_ns, self._sensors)
        self._last_ns = checked.t_ns
        return super().step(checked)

    def restart(self) -> None:
        """Restart from the initial memory; the next frame may have any time."""
        self._last_ns = None
        super().restart()


def _decision(
    actuator: Actuator, out: Any, modules: Sequence[str | None], ffi: Any
) -> Callable[[list[FrameEvent]], Decision]:
    """Return a function that reads the decision on an actuator, and adds its records."""
    name, fields = actuator.name, [f"{actuator.name}.{f.name}" for f in actuator.fields]
    head = attrgetter("by", "reason", "sent")
    command = out.command if fields else None
    changed = ffi.buffer(out.changed) if fields else b""
    members, is_single = [identifier(f.name) for f in actuator.fields], len(fields) == 1
    fetch: Callable[[Any], Any] = attrgetter(*members) if members else lambda _: ()

    def decide(records: list[FrameEvent]) -> Decision:
        number, reason, is_sent = head(out)
        by, fault = modules[number], _REASONS[reason]
        if fault is not None:
            subject = by if fault in ("missing", "not finite") else fields[out.reason_field]
            records.append(FrameEvent(fault, subject or ""))
        changes = bytes(changed)
        if changes.strip(b"\0"):
            pairs = zip(changes, fields, strict=True)
            records.extend([FrameEvent(_CHANGES[x], field) for x, field in pairs if x])
        values = None
        if is_sent:
            values = (fetch(command),) if is_single else fetch(command)
        return Decision(name, by, values, fault)

    return decide


def _take(sensor: Sensor, member: Any) -> _Take:
    name, ages, convert = sensor.name, sensor.within_ns is not None, _conversion(sensor)

    def take(readings: Mapping[str, Any], t_ns: int, taken_ns: Mapping[str, int]) -> None:
        if name not in readings:
            member.given = _ABSENT
            return
        reading, taken = readings[name], taken_ns.get(name, t_ns) if taken_ns else t_ns
        if taken > t_ns:
            member.given = _FAULTY
        elif reading is None:
            member.given = _LOST
        elif (value := convert(reading)) is None:
            member.given = _FAULTY
        else:
            member.value, member.given = value, _GIVEN
            if ages:
                member.taken_ns = taken

    return take


def _conversion(sensor: Sensor) -> Callable[[Any], Any]:
    """Return the function that returns a reading as cffi takes it, or None if it is of another type."""
    is_bool = isinstance(element_type(sensor.type), Bool)
    if not isinstance(sensor.type, Array):
        return _bool if is_bool else _number
    size = sensor.type.size
    kind: type[float] = bool if is_bool else float
    usual = [kind] * size

    def convert(reading: Any) -> Any:
        if not isinstance(reading, list | tuple):
            return None
        if [*map(type, reading)] == usual:
            return reading
        if is_bool or len(reading) != size:
            return None
        numbers = [_number(x) for x in reading]
        return None if None in numbers else numbers

    return convert


def _number(reading: Any) -> float | None:
    return reading if type(reading) is float else as_float(reading)  # C sees that it is not NaN


def _bool(reading: Any) -> bool | None:
    return reading if isinstance(reading, bool) else None
