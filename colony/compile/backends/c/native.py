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
from colony.ir.program import Sensor
from colony.ir.types import Array, Bool, element_type

STRICT = ("-std=c99", "-ffp-contract=off", "-O2")
"""Options of the compiler that keep arithmetic that of IEEE 754."""

COMPILE_SECONDS = 600.0
"""Timeout in seconds of the C compiler."""

_MAX_BYTES = 256 * 1024 * 1024

_ABSENT, _GIVEN, _FAULTY, _LOST = range(4)
_REASONS = (None, "missing", "not finite", "bound missing", "limits contradict")
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
                keep_in_cache(file, target.read_bytes())
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
    try:
        return read_from_cache(file, _MAX_BYTES) if file is not None else b""
    except OSError:
        return b""


def _imported(name: str, path: Path) -> Any:
    spec = spec_from_file_location(name, path)
    assert spec is not None
    assert spec.loader is not None
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


# --- the executor -------------------------------------------------------------------------------------


class CExecutor:
    """An executor of a program compiled to C (see `ir.frame.Executor`). Stateful: it holds all memory."""

    def __init__(self, text: CText, module: Any) -> None:
        """Take the module that `built` returned for the text."""
        ffi, lib, p = module.ffi, module.lib, text.name
        self._init, self._step = getattr(lib, f"{p}_init"), getattr(lib, f"{p}_step")
        self._memory, self._frame, self._out = (
            ffi.new(f"struct {p}_{x} *") for x in ("memory", "frame", "outcome")
        )
        code = text.compiled.code
        self._takes = [
            _take(sensor, getattr(self._frame, member))
            for sensor, member in zip(code.sensors, text.sensors, strict=True)
        ]
        self._declared = code.sensors
        self._sensors = tuple(s.name for s in code.sensors)
        self._found = ffi.buffer(self._out.found) if code.sensors else b""
        self._broken = ffi.buffer(self._out.broken) if code.contracts else b""
        self._contracts = tuple(c.name for c in code.contracts)
        self._modules = (None, *text.modules)
        self._actuators = []
        for actuator, member in zip([a.actuator for a in code.actuators], text.actuators, strict=True):
            out, names = getattr(self._out, member), [f"{actuator.name}.{f.name}" for f in actuator.fields]
            members = [identifier(f.name) for f in actuator.fields]
            command = out.command if members else None
            changed = ffi.buffer(out.changed) if members else b""
            self._actuators.append((actuator.name, out, command, members, changed, names))
        self.restart()

    def write(self, frame: Frame) -> None:
        """Write a frame into the struct that the next step reads."""
        c, readings, t_ns, taken_ns = self._frame, frame.readings, frame.t_ns, frame.taken_ns
        c.t_ns, c.restarted = t_ns, frame.restarted
        for name, take in self._takes:
            if name in readings:
                take(readings[name], t_ns, taken_ns.get(name, t_ns))
            else:
                take.absent()

    def step(self, frame: Frame) -> Outcome:
        """Execute one frame."""
        self.write(frame)
        self._step(self._memory, self._frame, self._out)
        records: list[FrameEvent] = []
        found = bytes(self._found)
        if found.translate(None, b"\0\1"):
            records += [
                FrameEvent(_FOUND[x], name) for x, name in zip(found, self._sensors, strict=True) if x > 1
            ]
        decisions = tuple([self._decision(*actuator, records) for actuator in self._actuators])
        broken = bytes(self._broken)
        breaches = (
            tuple([name for x, name in zip(broken, self._contracts, strict=True) if x]) if 1 in broken else ()
        )
        return Outcome(decisions, tuple(records), breaches)

    def _decision(
        self,
        actuator: str,
        out: Any,
        command: Any,
        members: list[str],
        changed: Any,
        names: list[str],
        records: list[FrameEvent],
    ) -> Decision:
        by, fault = self._modules[out.by], _REASONS[out.reason]
        if fault is not None:
            at_module = fault in ("missing", "not finite")
            records.append(FrameEvent(fault, by if at_module else names[out.reason_field]))  # type: ignore[arg-type]
        changes = bytes(changed)
        if any(changes):
            records += [FrameEvent(_CHANGES[x], name) for x, name in zip(changes, names, strict=True) if x]
        values = tuple([getattr(command, member) for member in members]) if out.sent else None
        return Decision(actuator, by, values, fault)

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
        checked = checked_frame(frame, self._last_ns, self._declared)
        self._last_ns = checked.t_ns
        return super().step(checked)

    def restart(self) -> None:
        """Restart from the initial memory; the next frame may have any time."""
        self._last_ns = None
        super().restart()


class _Take:
    """A sensor's place in the frame. Mutable: calls write a reading."""

    def __init__(self, member: Any, convert: Callable[[Any], Any], ages: bool) -> None:
        self._member, self._convert, self._ages = member, convert, ages

    def __call__(self, reading: Any, t_ns: int, taken_ns: int) -> None:
        member = self._member
        if taken_ns > t_ns:
            member.given = _FAULTY
        elif reading is None:
            member.given = _LOST
        else:
            value = self._convert(reading)
            if value is None:
                member.given = _FAULTY
                return
            member.value, member.given = value, _GIVEN
            if self._ages:
                member.taken_ns = taken_ns

    def absent(self) -> None:
        """Write that there is no reading."""
        self._member.given = _ABSENT


def _take(sensor: Sensor, member: Any) -> tuple[str, _Take]:
    is_bool, size = isinstance(element_type(sensor.type), Bool), 0
    if isinstance(sensor.type, Array):
        size = sensor.type.size
    convert = _bools(size) if is_bool and size else _bool if is_bool else _numbers(size) if size else _number
    return sensor.name, _Take(member, convert, sensor.within_ns is not None)


def _number(reading: Any) -> float | None:
    return reading if type(reading) is float else as_float(reading)  # C sees that it is not NaN


def _bool(reading: Any) -> bool | None:
    return reading if isinstance(reading, bool) else None


def _bools(size: int) -> Callable[[Any], Any]:
    def convert(reading: Any) -> Any:
        if not isinstance(reading, list | tuple) or len(reading) != size:
            return None
        return reading if all(isinstance(x, bool) for x in reading) else None

    return convert


def _numbers(size: int) -> Callable[[Any], Any]:
    def convert(reading: Any) -> Any:
        if not isinstance(reading, list | tuple) or len(reading) != size:
            return None
        if set(map(type, reading)) == {float}:
            return reading
        numbers = [as_float(x) for x in reading]
        return None if None in numbers else numbers

    return convert
