"""Files from outside, changed at random: recordings, input frames and compiled programs.

A mutant is read by a command in this process, as the console script runs it. It must end with an exit code:
0, 1 or 2, within `PATIENCE_S` and without a bug's traceback.
"""

from __future__ import annotations

import io
import json
import random
import struct
import sys
import time
import zlib
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, redirect_stderr, redirect_stdout
from hashlib import sha256
from pathlib import Path
from typing import Any, NamedTuple

import lz4.frame
import msgspec
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import Chunk

from colony.cli.main import _run
from colony.cli.watch import _recorded
from colony.compile.backends.python.generate import generate, load
from colony.dsl.load import load_file
from colony.execute.colonyc import encode
from colony.execute.compiled import SourceFile
from colony.execute.executor import ProgramExecutor
from colony.ir.frame import Frame
from colony.runs.compiled import compiled_with_sources, read_compiled
from colony.runtime.recordings.lines import add_checksum
from colony.runtime.recordings.mcap_writer import CHECKSUM, checksum
from colony.runtime.recordings.replay import CHECKSUM_PREFIX
from colony.text.diagnostics import DiagnosticError
from tests.analysis.recorded_runs import MS, as_lines, as_mcap, logs
from tests.runtime.recordings.mcap_files import TEXT, trace

PATIENCE_S = 2.0
"""Seconds of processor time that a command may take for a mutant."""

EDGES = (0, 1, 2, 7, 0x7F, 0xFF, 0xFFFF, 2**31 - 1, 2**31, 2**32 - 1, 2**62, 2**63 - 1, 2**63, 2**64 - 1)
"""Values of fields at which arithmetic overflows, or sizes become negative."""

ODD = (
    *(None, True, False, -1, 0, 1, 2**31, 2**63, 2**64, 10**400, -(2**70), 1e308, float("inf"), float("nan")),
    *(
        "",
        "nan",
        "\ud800",
        "\0",
        "x" * 3000,
        "../x",
        "cruise",
        [],
        [None] * 3,
        [[[]]],
        {},
        {"": 0},
        {"k": {}},
    ),
)
"""JSON values in the place of others."""


def deep() -> Any:
    """Return a list that nests deeper than any reader."""
    value: Any = 0
    for _ in range(600):
        value = [value]
    return value


# --- bytes -----------------------------------------------------------------------------------------


def flip(data: bytes, chance: random.Random) -> bytes:
    out = bytearray(data)
    for _ in range(chance.choice((1, 1, 1, 4))):
        out[chance.randrange(len(out))] ^= 1 << chance.randrange(8)
    return bytes(out)


def cut(data: bytes, chance: random.Random) -> bytes:
    return data[: chance.randrange(len(data))]


def splice(data: bytes, chance: random.Random) -> bytes:
    a, b = sorted((chance.randrange(len(data)), chance.randrange(len(data))))
    at = chance.randrange(len(data))
    piece = chance.choice(
        (data[a:b], b"", chance.randbytes(chance.randrange(200)), bytes(chance.randrange(200)))
    )
    return data[:at] + piece + data[chance.choice((at, at, min(len(data), at + len(piece)), b)) :]


def edge(data: bytes, chance: random.Random) -> bytes:
    layout = chance.choice(("<B", "<H", "<I", "<Q"))
    size = struct.calcsize(layout)
    at = chance.randrange(max(1, len(data) - size))
    value = chance.choice(EDGES) & (2 ** (8 * size) - 1)
    return data[:at] + struct.pack(layout, value) + data[at + size :]


BYTES = (flip, cut, splice, edge)


# --- JSON ------------------------------------------------------------------------------------------


def odd_json(value: Any, chance: random.Random) -> Any:
    """Return a JSON value of which one part is missing, another, or called otherwise."""
    if isinstance(value, dict) and value and chance.random() < 0.9:
        key = chance.choice(list(value))
        rest = {k: v for k, v in value.items() if k != key}
        match chance.randrange(6):
            case 0:
                return rest
            case 1:
                return {**rest, chance.choice(("", "x", "\ud800", "t", "@tick", "drive", "k")): value[key]}
            case _:
                return {**value, key: odd_json(value[key], chance)}
    if isinstance(value, list) and value and chance.random() < 0.7:
        at = chance.randrange(len(value))
        return [*value[:at], *([odd_json(value[at], chance)] * chance.randrange(3)), *value[at + 1 :]]
    return deep() if chance.random() < 0.03 else chance.choice(ODD)


def odd_text(data: bytes, chance: random.Random) -> bytes:
    """Return a JSON text with an odd value in it, as far as it is JSON."""
    try:
        text = json.dumps(odd_json(json.loads(data), chance))
    except ValueError:
        return flip(data, chance) if data else b"{"
    return text.replace("Infinity", chance.choice(("Infinity", "1e999"))).encode()


def lines(data: bytes, chance: random.Random) -> bytes:
    """Return JSON lines with an odd value in one of them, or in another order."""
    out = data.splitlines(keepends=True)
    at = chance.randrange(len(out))
    match chance.randrange(6):
        case 0:
            out.insert(chance.randrange(len(out)), out[at])
        case 1:
            del out[at : at + chance.randrange(1, len(out))]
        case 2:
            chance.shuffle(out)
        case _:
            at = chance.choice((0, at))
            line = out[at][: out[at].rfind(CHECKSUM_PREFIX)] + b"}" if CHECKSUM_PREFIX in out[at] else out[at]
            text = odd_text(line, chance)
            is_object = text.endswith(b"}") and chance.random() < 0.8
            out[at] = (add_checksum(text[:-1].decode()) if is_object else text.decode()).encode() + b"\n"
    return b"".join(out)


# --- MCAP ------------------------------------------------------------------------------------------


class Framed(NamedTuple):
    """A record as it is in the file."""

    opcode: int
    content: bytes

    @property
    def data(self) -> bytes:
        return struct.pack("<BQ", self.opcode, len(self.content)) + self.content


def framed(data: bytes) -> Iterator[Framed]:
    at = 0
    while at + 9 <= len(data):
        opcode, length = struct.unpack_from("<BQ", data, at)
        yield Framed(opcode, data[at + 9 : at + 9 + length])
        at += 9 + length


def records(data: bytes, chance: random.Random) -> bytes:
    """Return a recording with right lengths and checksums, of which a record is another."""
    magic = data[:8]
    out = list(framed(data[8:-8]))
    at = chance.choice([i for i in range(len(out)) if chance.random() < 0.5] or [0])
    match chance.randrange(8):
        case 0:
            out.insert(chance.randrange(len(out)), out[at])
        case 1:
            del out[at]
        case 2:
            other = chance.randrange(len(out))
            out[at], out[other] = out[other], out[at]
        case 3:
            extra = Framed(chance.randrange(256), chance.randbytes(chance.choice((0, 4, 40))))
            out[at:at] = [extra] * chance.choice((1, 300))
        case _:
            out[at] = changed(out[at], chance)
    return magic + b"".join(record.data for record in out) + magic


def changed(record: Framed, chance: random.Random) -> Framed:
    """Return a record with another content, and the checksum of that."""
    content = record.content
    match record.opcode:
        case Opcode.CHUNK:
            return chunk(content, chance)
        case Opcode.ATTACHMENT:
            body = chance.choice((attachment, *BYTES))(content[:-4], chance)
            return Framed(record.opcode, body + struct.pack("<I", zlib.crc32(body)))
        case Opcode.METADATA:
            return metadata(content, chance)
        case _:
            return Framed(record.opcode, chance.choice(BYTES)(content, chance) if content else b"\0")


def attachment(body: bytes, chance: random.Random) -> bytes:
    """Return an attachment of another name, which is a path."""
    (size,) = struct.unpack_from("<I", body, 16)
    name = body[20 : 20 + size].decode()
    path = chance.choice(
        ("../" * 5 + "x", "/proc/self/environ", "a/" * 1500 + "b", "x" * 300, ".", "a\0b", "\n")
    )
    name = chance.choice((name.partition("/")[0] + "/" + path, path, name + "/" + path, name + "x"))
    return body[:16] + text(name) + body[20 + size :]


def text(value: str) -> bytes:
    data = value.encode("utf-8", "surrogatepass")
    return struct.pack("<I", len(data)) + data


def metadata(content: bytes, chance: random.Random) -> Framed:
    """Return metadata of which a member is another, with the checksum of the members."""
    strings, at = [], 0
    (size,) = struct.unpack_from("<I", content)
    strings.append(content[4 : 4 + size].decode())
    at = 8 + size
    while at < len(content):
        (size,) = struct.unpack_from("<I", content, at)
        strings.append(content[at + 4 : at + 4 + size].decode())
        at += 4 + size
    members = dict(zip(strings[1::2], strings[2::2], strict=True))
    key = chance.choice(list(members) or [""])
    value = members.get(key, "")
    members[chance.choice((key, key, "x", ""))] = chance.choice(
        (
            "",
            "-1",
            "1e9",
            "x" * 5000,
            "null",
            "true",
            str(2**64),
            odd_text(value.encode(), chance).decode(errors="replace"),
        )
    )
    members[CHECKSUM] = checksum(members) if chance.random() < 0.9 else "x"
    body = b"".join(text(k) + text(v) for k, v in members.items())
    return Framed(Opcode.METADATA, text(strings[0]) + struct.pack("<I", len(body)) + body)


def chunk(content: bytes, chance: random.Random) -> Framed:
    """Return a chunk whose messages are other ones."""
    start, end, _, _, name = struct.unpack_from("<QQQII", content)
    packed = content[32 + name + 8 :]
    inner = list(framed(zstandard.decompress(packed) if name else packed))
    at = chance.randrange(len(inner))
    match chance.randrange(6):
        case 0:
            chance.shuffle(inner)
        case 1:
            inner.insert(chance.randrange(len(inner)), inner[at])
        case 2:
            inner[at] = Framed(inner[at].opcode, chance.choice(BYTES)(inner[at].content, chance))
        case _:
            messages = [i for i, record in enumerate(inner) if record.opcode == Opcode.MESSAGE] or [at]
            at = chance.choice(messages)
            head, body = inner[at].content[:22], inner[at].content[22:]
            inner[at] = Framed(inner[at].opcode, head + odd_text(body, chance))
    if chance.random() < 0.1:
        return inner[at]  # outside the chunk
    data = b"".join(record.data for record in inner)
    compression = chance.choice(("", "zstd", "lz4"))
    pack: dict[str, Callable[[bytes], bytes]] = {
        "": bytes,
        "zstd": zstandard.compress,
        "lz4": lz4.frame.compress,
    }
    builder = RecordBuilder()
    Chunk(
        compression=compression,
        data=pack[compression](data),
        message_start_time=start,
        message_end_time=end,
        uncompressed_crc=zlib.crc32(data),
        uncompressed_size=len(data),
    ).write(builder)
    out: bytes = builder.end()  # type: ignore[no-untyped-call]
    return Framed(Opcode.CHUNK, out[9:])


# --- compiled programs -----------------------------------------------------------------------------


def program(data: bytes, chance: random.Random) -> bytes:
    """Return a compiled program with the right checksum, of which a value is another."""
    head = data[:9]
    body = data[9 + 32 :]
    if chance.random() < 0.7:
        body = msgspec.msgpack.encode(odd_value(msgspec.msgpack.decode(body), chance))
    else:
        body = chance.choice(BYTES)(body, chance)
    return head + sha256(body).digest() + body


def odd_value(value: Any, chance: random.Random) -> Any:
    """Return data of which one part is another, at any depth."""
    if isinstance(value, dict) and value and chance.random() < 0.97:
        key = chance.choice(list(value))
        return {**value, key: odd_value(value[key], chance)}
    if isinstance(value, list) and value and chance.random() < 0.97:
        at = chance.randrange(len(value))
        return [
            *value[:at],
            *([odd_value(value[at], chance)] * chance.choice((1, 1, 1, 0, 2))),
            *value[at + 1 :],
        ]
    if isinstance(value, int) and chance.random() < 0.6:
        return value + chance.choice((-1, 1, 2, 1000))
    found = chance.choice(ODD)
    wide = isinstance(found, int) and not -(2**63) <= found < 2**64
    return 0 if wide or found == "\ud800" else found


# --- what reads them -------------------------------------------------------------------------------


MutantOf = Callable[[bytes, random.Random], bytes]

PYTHON = "class Plan:\n    def step(self, frame):\n        return frame.drive(velocity=1.0, turn=0.0)\n"
TEXTS = {
    "b.colony": TEXT,
    "m.colony": """
robot rome {
  sensor near : mm range 0 .. 5000 from PServer.near within 300 ms
  sensor word : number default 0 from DServer.Word
  actuator drive { velocity : mm/s range -600 .. 600 } to RServer.drive idle drive(velocity = 0)
}
param far = 2 m
state count : number = 0
next count = if near > far then count + 1 else count
module cruise { when near >= far do drive(velocity = near / 1 s) }
module back { when near < far do drive(velocity = -100 mm/s) }
network { drive = back suppresses[200 ms] cruise }
contract slow: drive.velocity <= 600 mm/s
""",
    "p.colony": """
robot rome {
  sensor near : mm range 0 .. 5000 from PServer.near
  actuator drive { velocity : mm/s range -600 .. 600 } to RServer.drive idle drive(velocity = 0)
}
module pulse from python "tests.verify.scripted_modules:Pulses" { reads near  commands drive }
module cruise { when near >= 0 mm do drive(velocity = near / 1 s) }
network { drive = pulse suppresses[100 ms] cruise }
""",
}


class Case(NamedTuple):
    """A kind of file: its content, what changes it, and the commands that read it, `{}` for its path."""

    content: bytes
    mutants: Sequence[MutantOf]
    commands: Sequence[Sequence[str]]


RECORDING = (("audit", "{}"), ("trace", "--input", "{}"), ("explain", "{}", "--at", "0.3"), ("watch", "{}"))


def cases(folder: Path) -> dict[str, Case]:
    """Return the files that are changed, by name, and write the behaviors that are beside them."""
    out = {}
    for name, of in TEXTS.items():
        path = folder / name
        path.write_text(of)
        behavior = load_file(path)
        log = logs(behavior, trace(14), missing=(9,))
        source = SourceFile(kind="behavior", path=name, data=of.encode())
        python = SourceFile(kind="python", path="pkg/mod.py", data=PYTHON.encode())
        with_file = (
            ("audit", "{}", str(path)),
            ("trace", str(path), "--input", "{}"),
            ("explain", "{}", str(path), "--when", "drive is idle"),
            ("watch", "{}", "--behavior", str(path)),
        )
        mcap, jsonl = as_mcap(behavior, log, python, source).content, as_lines(behavior, log).content
        out[f"{path.stem}.mcap"] = Case(mcap, (*BYTES, records, records, records), (*RECORDING, *with_file))
        out[f"{path.stem}.jsonl"] = Case(jsonl, (*BYTES, lines, lines, lines), with_file)
        if path.stem == "p":
            continue  # a changed program could import any module
        frames = b"".join(
            json.dumps({"t": f.t_ns / 1e9, **{k: v for k, v in f.readings.items() if k in of}}).encode()
            + b"\n"
            for f in (Frame(k * 50 * MS, {"near": 100.0 * k}) for k in range(8))
        )
        backends = [
            ("trace", str(path), "--input", "{}", "--backend", b) for b in ("network", "clients", "python")
        ]
        out[f"{path.stem}.input"] = Case(frames, (*BYTES, lines, lines), backends)
        compiled = encode(compiled_with_sources(behavior, print).compiled)
        out[f"{path.stem}.colonyc"] = Case(compiled, (*BYTES, program, program, program), (("run", "{}"),))
    return out


def read(command: Sequence[str], path: Path) -> tuple[int, str]:
    """Run a command over a file in this process; return its exit code, and what it said."""
    said = io.StringIO()
    arguments = [part.format(path) for part in command]
    with redirect_stdout(said), redirect_stderr(said):
        if arguments[0] == "watch":
            return watched(path, arguments[3] if len(arguments) > 2 else None), said.getvalue()
        if arguments[0] == "run":
            return executed(path), said.getvalue()
        sys.argv = ["colony", *arguments]
        return _run(), said.getvalue()


def executed(path: Path) -> int:
    """Read a compiled program, and decide a few frames with it; return the exit code."""
    try:
        compiled = read_compiled(path)
    except DiagnosticError:
        return 2
    executors = (ProgramExecutor(compiled), load(generate(compiled)))
    for frame in trace(4):
        for executor in executors:
            executor.step(frame)
    return 0


def watched(path: Path, behavior: str | None) -> int:
    """Fill the page of a recording, as `colony watch` does; return the exit code."""
    import click

    with ExitStack() as resources:
        try:
            resources.enter_context(click.Context(click.Command("watch")))
            store = _recorded(str(path), behavior, None, resources).store
        except click.exceptions.Exit as done:
            return done.exit_code
        while not store.is_complete:
            time.sleep(0.001)
        print(store.problem)
        assert "cannot be read or kept" not in str(store.problem), store.problem
        return 0


class Found(NamedTuple):
    """A mutant that was not read as it should be."""

    case: str
    seed: str
    command: tuple[str, ...]
    problem: str


def try_mutant(name: str, case: Case, seed: str, folder: Path) -> tuple[int | None, Found | None]:
    """Let a command read one mutant; return the exit code, and what is wrong."""
    chance = random.Random(seed)
    mutant = chance.choice(case.mutants)(case.content, chance)
    if chance.random() < 0.1:
        mutant = chance.choice(BYTES)(mutant, chance) if mutant else mutant
    path, command = folder / f"x.{name.partition('.')[2]}", tuple(chance.choice(case.commands))
    path.write_bytes(mutant)
    begin = time.process_time()
    try:
        code, said = read(command, path)
    except Exception as problem:
        import traceback

        return None, Found(name, seed, command, "".join(traceback.format_exception(problem)[-6:]))
    took = time.process_time() - begin
    if code not in (0, 1, 2) or "Traceback" in said:
        return code, Found(name, seed, command, f"{code}: {said}")
    if took > PATIENCE_S:
        return code, Found(name, seed, command, f"{took:.1f} s")
    return code, None
