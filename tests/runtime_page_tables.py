"""The tables of docs/runtime.md, from the code; `python -m tests.runtime_page_tables` writes them into it."""

from __future__ import annotations

import inspect
import re
import types
import typing
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import msgspec

from colony.body.shipped import shipped_servers
from colony.ir.servers import OMNIDIRECTIONAL_RSERVER, RSERVER
from colony.runtime.assembly.processes.run_status import LeaderServer
from colony.runtime.frames.clock import Clock
from colony.runtime.kit import description
from colony.runtime.kit.commands import command
from colony.runtime.kit.description import FieldReader
from colony.runtime.kit.service import Service
from colony.runtime.library import actuator, camera, clock, data, leader, proximity, robot
from colony.runtime.library.ask import CallRequest
from colony.runtime.protocol.calls import CallDispatcher, Method
from colony.runtime.servers.cserver import CServer
from colony.runtime.servers.dserver import DServer
from colony.runtime.servers.pserver import PServer
from colony.runtime.servers.rserver import RServer
from colony.runtime.transport.live import gateway
from colony.runtime.transport.live.gateway import GatewayNode
from tests.runtime.scripted import Script

PAGE = Path(__file__).parent.parent / "docs" / "runtime.md"

SAMPLES: Mapping[Any, Any] = {
    str: "a",
    int: 1,
    float: 1.0,
    bool: True,
    object: 1,
    "Sequence[float]": [1.0],
    "Iterable[str]": ("a",),
    "Mapping[str, object]": {"a": 1},
    "Mapping[str, bool | float]": {"a": 1.0},
    "Mapping[str, float | None]": {"a": 1.0},
    "Deployment": None,
}
"""An argument of each type that functions of the library have."""


NAMED = {"-1.0": "KEEP_SETTING", "typing.Any": "Any"}
"""Defaults that go by a name."""


class Server(NamedTuple):
    """A server of the page: its name, a node of it, and the modules with the functions that ask it."""

    name: str
    node: Callable[[], object]
    library: types.ModuleType
    remark: str = ""
    borrows: Mapping[str, types.ModuleType] = {}
    """Methods for which its library has no function, but another one."""


class _Camera:
    def grab(self) -> None:
        return None


class _Security(NamedTuple):
    users: dict[str, tuple[str, ...]] = {}  # noqa: RUF012


COMMANDED = {
    **dict.fromkeys(("command", "give_way", "ignore_limits", "lock", "unlock", "arbitration"), actuator),
    "deploy": clock,
}
"""Methods of every server that takes commands, but for RServer."""


def own_server() -> Service:
    """Return a server made with the kit that takes a command."""
    return Service("Own", (), FieldReader("Own", (), print), print, commands=[command("move", lambda: None)])


LISTED = (
    Server("RServer", lambda: RServer(Script()), robot),
    Server("PServer", lambda: PServer(Script(), frames_kept=2), proximity),
    Server("DServer", lambda: DServer({}, frames_kept=2), data, borrows=COMMANDED),
    Server("CServer", lambda: CServer(_Camera(), frames_kept=2), camera),
    Server("Clock", lambda: Clock(servers=(), frames_kept=2), clock),
    Server("Leader", lambda: LeaderServer(None), leader, "the process of `colony run`"),  # type: ignore[arg-type]
    Server("Gateway", lambda: GatewayNode(_Security()), gateway, "the way in from other machines"),  # type: ignore[arg-type]
    Server("A server of your own", own_server, description, "besides its methods", borrows=COMMANDED),
)


# --- the tables ------------------------------------------------------------------------------------


def calls_text() -> str:
    """The tables of calls."""
    return "\n".join(_calls_of(server) for server in LISTED)


def fields_text() -> str:
    """The table of fields."""
    rows = [("field", "type", "")]
    for server in shipped_servers("rome"):
        fields = OMNIDIRECTIONAL_RSERVER.fields if server.name == RSERVER.name else server.fields
        rows += [(f"`{server.name}.{f.name}`", str(f.type), f.meaning) for f in fields]
    return _table(rows)


def commands() -> dict[str, str]:
    """The fields of the one command that servers of hardware have, with their units."""
    [command] = OMNIDIRECTIONAL_RSERVER.commands
    return {p.name: str(p.type) for p in command.parameters}


def page() -> str:
    """The page, with its tables as they should be."""
    text = PAGE.read_text(encoding="utf-8")
    for mark, table in (("fields", fields_text()), ("calls", calls_text())):
        begin = f"<!-- {mark} -->\n"
        pattern = re.escape(begin) + r".*?<!-- end -->"
        text = re.sub(
            pattern, lambda _, table=table, begin=begin: f"{begin}\n{table}\n<!-- end -->", text, flags=re.S
        )
    return text


def _calls_of(server: Server) -> str:
    functions = _functions(server.library)
    for method, library in server.borrows.items():
        borrowed = _functions(library)[method]
        functions[method] = borrowed._replace(name=f"{library.__name__.rpartition('.')[2]}.{borrowed.name}")
    rows = [("call", "arguments", "result", "needs", "")]
    for found in _methods(server.node()):
        function = functions.pop(found.name, None)
        assert function is not None, f"{server.name}.{found.name} has no function in its library"
        assert function.ask.right == found.right, f"{server.name}.{found.name}"
        assert isinstance(function.ask.arguments, found.arguments | types.NoneType), (
            f"{server.name}.{found.name}"
        )
        called = (
            f"`{function.name}`"
            if function.name.endswith(found.name)
            else f"`{function.name}` (`{found.name}`)"
        )
        rows.append((called, function.signature, _result(function.ask.reply), found.right, function.meaning))
    assert not functions, f"{server.name} does not have {', '.join(functions)}"
    remark = f", {server.remark}" if server.remark else ""
    where = server.library.__name__
    return f"### {server.name}{remark}\n\nFunctions of `{where}`.\n\n{_table(rows)}"


def _table(rows: Iterable[tuple[str, ...]]) -> str:
    head, *rest = [tuple(cell.replace("|", "\\|") for cell in row) for row in rows]
    lines = [head, tuple("---" for _ in head), *rest]
    return "\n".join(f"| {' | '.join(line)} |".replace("  ", " ") for line in lines) + "\n"


# --- servers ---------------------------------------------------------------------------------------


def _methods(node: object) -> Iterator[Method]:
    """The methods of a node's desk, but for those that every server has."""
    [desk] = _desks(node)
    always = {"open", "close", "status"}
    yield from (m for m, _ in desk._methods.values() if m.name not in always)


def _desks(node: object) -> Iterator[CallDispatcher]:
    for value in vars(node).values():
        if isinstance(value, CallDispatcher):
            yield value
        elif type(value).__name__ == "DataCalls":
            yield from _desks(value)


# --- libraries -------------------------------------------------------------------------------------


class _Function(NamedTuple):
    """A function of a library: what it asks for, its arguments as on the page, and what it is for."""

    name: str
    ask: CallRequest[Any]
    signature: str
    meaning: str


def _functions(module: types.ModuleType) -> dict[str, _Function]:
    """By the method that each asks for."""
    found = {}
    for name, function in vars(module).items():
        if not inspect.isfunction(function) or name.startswith("_"):
            continue
        if not str(inspect.signature(function).return_annotation).startswith("CallRequest"):
            continue
        ask = function(*_samples(function))
        found[ask.method] = _Function(name, ask, _signature(function), _meaning(function))
    return found


def _samples(function: Callable[..., Any]) -> Iterator[Any]:
    names = {"str": str, "int": int, "float": float, "bool": bool, "object": object}
    for parameter in inspect.signature(function).parameters.values():
        if parameter.default is inspect.Parameter.empty and parameter.kind is not parameter.VAR_POSITIONAL:
            yield SAMPLES[names.get(parameter.annotation, parameter.annotation)]


def _signature(function: Callable[..., Any]) -> str:
    shown = []
    for p in inspect.signature(function).parameters.values():
        if p.kind is p.VAR_POSITIONAL:
            shown.append(f"*{p.name}")
        elif p.default is inspect.Parameter.empty:
            shown.append(p.name)
        else:
            default = NAMED.get(repr(p.default), repr(p.default))
            shown.append(f"{p.name} = {default}")
    return f"`{', '.join(shown)}`" if shown else ""


def _meaning(function: Callable[..., Any]) -> str:
    """The first sentence of its docstring."""
    first = " ".join((inspect.getdoc(function) or "").split("\n\n")[0].split())
    return re.split(r"(?<=[.?])\s", first)[0].rstrip(".")


def _result(reply: Any) -> str:
    if reply is None or reply is type(None):
        return ""
    return f"`{_type(reply)}`"


def _type(kind: Any) -> str:
    if kind is type(None):
        return "None"
    if isinstance(kind, types.UnionType):
        return " | ".join(_type(part) for part in typing.get_args(kind))
    if typing.get_origin(kind) is typing.Literal:
        return "text"
    if isinstance(kind, type) and issubclass(kind, msgspec.Struct) and not typing.get_args(kind):
        return f"{kind.__name__}({', '.join(kind.__struct_fields__)})"
    if isinstance(kind, type) and not typing.get_args(kind):
        return kind.__name__
    return str(kind).replace("typing.", "").replace("colony.runtime.library.data.", "")


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
