"""A compiled program comes back from its bytes as it was; what is damaged or forged is refused."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator
from dataclasses import fields, is_dataclass, replace
from enum import Enum
from hashlib import sha256
from pathlib import Path
from random import Random
from typing import Any, get_args, get_type_hints

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from colony.cli.programs import compile_file
from colony.compile.lower.lower import lower
from colony.compile.pipeline import compile_program
from colony.dsl.load import load_file
from colony.execute.code import Apply, Cell, Code, Kind, Literal, OldCell, PythonActive, SensorElement, Table
from colony.execute.colonyc import MAX_BYTES, VERSION, SpanShape, decode, encode, is_compiled, read, to_shape
from colony.execute.compiled import Compiled
from colony.execute.executor import ProgramExecutor
from colony.execute.operators import Operator
from colony.ir.version import SEMANTICS
from colony.text.diagnostics import DiagnosticError
from colony.text.source import Span
from colony.verify.testing.agreement import disagreement
from colony.verify.testing.strategies import traces
from tests.drawn.strategies import programs
from tests.paths import BEHAVIORS, ROOT
from tests.sampling import sampled

HEAD = len(b"colonyc") + 2 + 32


def refused(data: bytes) -> str:
    with pytest.raises(DiagnosticError) as caught:
        decode(data, "p.colonyc")
    (found,) = caught.value.diagnostics
    assert (found.code, found.span.source.name) == ("C001", "p.colonyc")
    assert "\n" not in found.message
    return found.message


def signed(body: bytes) -> bytes:
    """Return a file with this content and its right sum, as a forger would make it."""
    return b"colonyc" + bytes([VERSION, SEMANTICS]) + sha256(body).digest() + body


@pytest.mark.parametrize("path", sampled(BEHAVIORS, every=4), ids=lambda path: path.stem)
def test_a_behavior_comes_back_with_its_sources_and_places(path: Path) -> None:
    compiled = compile_program(load_file(path)).compiled
    back = decode(encode(compiled), "p.colonyc")
    assert repr(replace(back, code=None)) == repr(replace(compiled, code=None))
    for name in ("ops", "kinds", "decided", "cells", "names", "memory_cells", "contracts", "sensors"):
        assert repr(getattr(back.code, name)) == repr(getattr(compiled.code, name)), name
    assert encode(back) == encode(compiled)
    for mine, theirs in zip(compiled.robot.sensors, back.robot.sensors, strict=True):
        assert (theirs.span.text, theirs.span.start) == (mine.span.text, mine.span.start)


@given(data=st.data())
def test_a_program_that_was_sent_does_what_the_reference_does(data: st.DataObject) -> None:
    program = data.draw(programs())
    executors = {
        name: lambda compilation, how=how: ProgramExecutor(  # type: ignore[misc]
            decode(encode(compilation.compiled), "p"), **how
        )
        for name, how in (
            ("sent", {}),
            ("exclusive", {"exclusive": True}),
            ("monitor", {"simplified": False}),
        )
    }
    found = disagreement(program, data.draw(traces(program)), executors)
    assert found is None, str(found)


# --- version -----------------------------------------------------------------------------------------

SHAPES = {
    1: "58598c1148994048",
    2: "123cdd989c0fc931",
    3: "07ced120fba76cf1",
    4: "93638d932ebdb229",
    5: "4527ee11c6b90bec",
    6: "32bc49a88a85b0c3",
    7: "2fad90c17ec07d59",
    8: "63414573be491d21",
    9: "7bcfa7e851681880",
    10: "9dc14a99224f1020",
}
"""For each version of the format, the digest of the data classes that it is made of."""


def described(hint: Any, found: dict[str, str]) -> str:
    """Return a type in words; `found` gets a line for each data class and each enumeration in it."""
    hint = SpanShape if hint is Span else hint
    name = getattr(hint, "__name__", "")
    if hint is SpanShape:
        found[name] = repr(get_type_hints(SpanShape))
    elif is_dataclass(hint) and name not in found:
        found[name] = ""  # so that a recursive type comes to an end
        hints = get_type_hints(hint)
        found[name] = ", ".join(f"{f.name}: {described(hints[f.name], found)}" for f in fields(hint))
    elif isinstance(hint, type) and issubclass(hint, Enum):
        found[name] = ", ".join(f"{one.name} = {one.value!r}" for one in hint)
    for argument in get_args(hint):
        described(argument, found)
    return name if isinstance(hint, type) and not get_args(hint) else re.sub(r"[\w.]+\.", "", repr(hint))


def test_a_change_of_a_data_class_is_a_new_version() -> None:
    found: dict[str, str] = {}
    described(Compiled, found)
    assert {"Compiled", "Code", "Sensor", "Operator", "SpanShape", "Cell"} <= found.keys()
    text = "\n".join(f"{name}: {found[name]}" for name in sorted(found))
    digest = sha256(text.encode()).hexdigest()[:16]
    assert SHAPES.get(VERSION) == digest, (
        f"the data classes of a compiled program have changed: add 1 to VERSION, and an entry here:\n{text}"
    )


# --- damage ------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def wander() -> Compiled:
    return compile_file(str(ROOT / "behaviors" / "wander.colony")).compiled


def test_other_bytes_and_other_versions_are_refused(wander: Compiled, tmp_path: Path) -> None:
    data = encode(wander)
    assert "does not begin" in refused(b"")
    assert "does not begin" in refused(b"robot r {}")
    other_format = refused(data[:7] + bytes([VERSION + 1]) + data[8:])
    assert f"its format is version {VERSION + 1}, this colony reads version {VERSION}" in other_format
    other_semantics = refused(data[:8] + bytes([SEMANTICS - 1]) + data[9:])
    assert f"of version {SEMANTICS - 1} of the semantics; this is version {SEMANTICS}" in other_semantics
    assert all("compile it again" in said for said in (other_format, other_semantics))
    for length in (7, 8):
        assert "compile it again" in refused(data[:length])
    assert "damaged" in refused(data[:-1])
    assert "damaged" in refused(data + b"\0")
    large = tmp_path / "large.colonyc"
    with open(large, "wb") as file:
        file.truncate(MAX_BYTES + 1)
    cut = tmp_path / "cut.colonyc"
    cut.write_bytes(data[:-1])
    for path in (large, tmp_path / "none.colonyc", tmp_path, cut):
        with pytest.raises(DiagnosticError, match="C001") as caught:
            read(path)
        (found,) = caught.value.diagnostics
        assert found.span.source.name == str(path)


@pytest.mark.parametrize(
    ("name", "content", "expected"),
    [
        ("a.colonyc", b"", True),
        ("a.colony", b"robot", False),
        ("a.colony", b"colony", False),
        ("a.colony", b"colonyc", True),
        ("a", b"colonyc\0", True),
    ],
)
def test_a_compiled_program_is_known_by_its_name_or_its_first_bytes(
    tmp_path: Path, name: str, content: bytes, expected: bool
) -> None:
    assert not is_compiled(tmp_path)
    (tmp_path / name).write_bytes(content)
    assert is_compiled(tmp_path / name) is expected


def test_bytes_that_are_damaged_and_signed_again_are_refused_or_harmless(wander: Compiled) -> None:
    """Whatever one byte becomes, reading ends: with a program that was checked, or in one line."""
    body = encode(wander)[HEAD:]
    random, outcomes = Random(1), set()
    for _ in range(400):
        changed = bytearray(body)
        changed[random.randrange(len(changed))] = random.randrange(256)
        try:
            decode(signed(bytes(changed)), "p.colonyc")
            outcomes.add("harmless")
        except DiagnosticError as failure:
            outcomes.add(failure.diagnostics[0].code)
    assert outcomes == {"harmless", "C001"}


@pytest.mark.parametrize("body", [b"", b"\xc0", b"\x91" * 100_000, b"\xdd\xff\xff\xff\xff", b"\xc1"])
def test_what_is_no_program_is_refused(body: bytes) -> None:
    refused(signed(body))


# --- forgery -----------------------------------------------------------------------------------------


def arrays_in(value: Any) -> Iterator[list[Any]]:
    if isinstance(value, list):
        yield value
    for one in value if isinstance(value, list) else value.values() if isinstance(value, dict) else ():
        yield from arrays_in(one)


def test_an_array_with_one_element_too_many_is_refused(wander: Compiled) -> None:
    """Wherever it is: nothing in the file is ignored."""
    body = msgspec.msgpack.decode(encode(wander)[HEAD:])
    count = 0
    for array in arrays_in(body):
        array.append(None)
        refused(signed(msgspec.msgpack.encode(body)))
        array.pop()
        count += 1
    assert count > 400
    assert encode(decode(signed(msgspec.msgpack.encode(body)), "p")) == encode(wander)


def with_op(at: int, op: Any, kind: Kind | None = None) -> Callable[[Code], Code]:
    def change(code: Code) -> Code:
        kinds = code.kinds if kind is None else (*code.kinds[:at], kind, *code.kinds[at + 1 :])
        return replace(code, ops=(*code.ops[:at], op, *code.ops[at + 1 :]), kinds=kinds)

    return change


def with_client(**parts: Any) -> Callable[[Code], Code]:
    def change(code: Code) -> Code:
        (one, *others) = code.actuators
        clients = (replace(one.clients[0], **parts), *one.clients[1:])
        return replace(code, actuators=(replace(one, clients=clients), *others))

    return change


def with_actuator(**parts: Any) -> Callable[[Code], Code]:
    def change(code: Code) -> Code:
        (one, *others) = code.actuators
        return replace(code, actuators=(replace(one, actuator=replace(one.actuator, **parts)), *others))

    return change


def with_field(**parts: Any) -> Callable[[Code], Code]:
    def change(code: Code) -> Code:
        (one, *others) = code.actuators
        fields = (replace(one.actuator.fields[0], **parts), *one.actuator.fields[1:])
        changed = replace(one, actuator=replace(one.actuator, fields=fields))
        return replace(code, actuators=(changed, *others))

    return change


def with_sensor(**parts: Any) -> Callable[[Code], Code]:
    return lambda code: replace(code, sensors=(replace(code.sensors[0], **parts), *code.sensors[1:]))


CELL = Cell(name="c", kind=Kind.NUMBER, initial=0.0, condition=0, value=0)


@pytest.mark.parametrize(
    "change",
    [
        with_op(0, Apply(Operator.NOT, (0,)), Kind.BOOL),
        with_op(0, Apply(Operator.AND, ()), Kind.BOOL),
        with_op(0, Table(()), Kind.TABLE),
        with_op(0, OldCell(99), Kind.NUMBER),
        with_op(0, SensorElement("nobody", 0), Kind.NUMBER),
        with_op(0, PythonActive("nobody"), Kind.BOOL),
        with_op(0, Literal(1), Kind.NUMBER),
        with_op(0, Literal(True), Kind.NUMBER),
        with_client(guard=100_000),
        with_client(unsimplified=-1),
        with_client(fields=()),
        with_client(priority=7),
        with_client(module="../x"),
        with_actuator(idle=()),
        with_actuator(name="a/b"),
        with_actuator(idle=(math.nan, 0.0)),
        with_actuator(idle=(1e300, 0.0)),
        with_actuator(idle=None),
        with_field(low=1.0, high=-1.0),
        with_field(low=math.nan),
        with_sensor(factor=0.0),
        with_sensor(low=math.nan),
        with_sensor(within_ns=-1),
        with_sensor(default=-1.0),
        with_sensor(name="*"),
        lambda code: replace(code, kinds=code.kinds[1:]),
        lambda code: replace(code, decided=len(code.ops) + 1),
        lambda code: replace(code, names={100_000: "x"}),
        lambda code: replace(code, memory_cells={"x": 100_000}),
        lambda code: replace(code, cells=(*code.cells, CELL)),
        lambda code: replace(code, sensors=(*code.sensors, code.sensors[0])),
    ],
)
def test_a_forged_program_is_refused(wander: Compiled, change: Callable[[Code], Code]) -> None:
    refused(encode(replace(wander, code=change(wander.code))))


@pytest.mark.parametrize("place", ["", ".", "..", "a/../../b", "/etc/x", "a\nb", "a\0b"])
def test_sources_of_a_forged_program_stay_in_their_folder(wander: Compiled, place: str) -> None:
    sources = (replace(wander.sources[0], path=place), *wander.sources[1:])
    assert "is not a relative path" in refused(encode(replace(wander, sources=sources, root=place)))


def test_sources_of_a_forged_program_are_one_each(wander: Compiled) -> None:
    assert "duplicate source" in refused(encode(replace(wander, sources=wander.sources * 2)))
    assert "not among the sources" in refused(encode(replace(wander, root="other.colony")))


@pytest.mark.parametrize("operator", [Operator.TIME_ADD, Operator.TIME_SUBTRACT])
def test_times_of_a_forged_program_cannot_grow(wander: Compiled, operator: Operator) -> None:
    at = len(wander.code.ops)
    ops = (*wander.code.ops, OldCell(len(wander.code.cells)), Apply(operator, (at, at)))
    cell = Cell(name="more", kind=Kind.TIME, initial=1, condition=at + 2, value=at + 1)
    code = replace(
        wander.code,
        ops=(*ops, Literal(True)),
        kinds=(*wander.code.kinds, Kind.TIME, Kind.TIME, Kind.BOOL),
        cells=(*wander.code.cells, cell),
    )
    refused(encode(replace(wander, code=code)))


def test_spans_lead_into_the_sources(wander: Compiled) -> None:
    shorter = replace(wander, sources=tuple(replace(s, data=s.data[:1]) for s in wander.sources))
    assert encode(shorter) != encode(wander)
    [robot] = [s.data for s in wander.sources if b"robot rome" in s.data]
    message = refused(signed(encode(wander)[HEAD:].replace(msgspec.msgpack.encode(robot), b"\xc4\x01x")))
    assert "span" in message
    decode(encode(shorter), "p")  # spans of other texts were left out


def placed(wander: Compiled, at: SpanShape) -> bytes:
    """Return the program with all its spans at one place, signed."""
    return signed(msgspec.msgpack.encode(to_shape(wander, lambda span: at)))


def test_a_span_is_three_numbers_in_the_file() -> None:
    assert msgspec.msgpack.encode(SpanShape(None, 1, 2)) == b"\x93\xc0\x01\x02"


def test_a_span_may_be_empty_and_reach_to_the_end(wander: Compiled) -> None:
    size = len(wander.sources[0].data.decode())
    for start, end in ((0, 0), (0, size), (size, size)):
        (span, *_) = (s.span for s in decode(placed(wander, SpanShape(0, start, end)), "p").robot.sensors)
        assert (span.start, span.end, len(span.source.text)) == (start, end, size)


def test_a_span_outside_the_sources_is_refused(wander: Compiled) -> None:
    size = len(wander.sources[0].data.decode())
    count = len(wander.sources)
    outside = ((-1, 0, 0), (count, 0, 0), (0, -1, 0), (0, 2, 1), (0, 0, size + 1), (0, size + 1, size + 1))
    for place in outside:
        assert "a span is outside its source" in refused(placed(wander, SpanShape(*place))), place


def test_a_program_without_sources_is_sent_without_places() -> None:
    from tests.runtime.programs import roam

    compiled = compile_program(replace(roam(), files=())).compiled
    assert compiled.root == ""
    assert decode(encode(compiled), "p") == compiled


def test_code_that_was_lowered_alone_can_be_sent() -> None:
    from tests.runtime.programs import roam

    compilation = compile_program(replace(roam(), files=()))
    alone = lower(compilation.program, compilation.clients, compilation.traversal)
    assert decode(encode(alone), "p") == compilation.compiled
