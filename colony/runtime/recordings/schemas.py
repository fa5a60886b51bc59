"""Channels of an MCAP recording, and the JSON schemas of their messages.

Viewers of recordings (Foxglove, Lichtblick) need schemas of plain objects: every property has one type, and
missing values are absent, never null.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import NamedTuple

from colony.execute.compiled import Compiled
from colony.ir.program import Actuator, ActuatorField, Sensor
from colony.ir.types import Array, Bool, Scalar

FRAMES = "/frames"
KEYFRAMES = "/keyframes"
CONTRACTS = "/contracts"
VERDICTS = "/verdicts/"
REQUESTS = "/requests/"
HEARD = "/heard/"
"""Topics; those that end in `/` are followed by the name of an actuator."""

SHADOW = "/shadow"
"""Prefix of verdicts and requests of a program in the shadow of a robot, which were not sent to it."""

Schema = dict[str, object]


class ChannelSchema(NamedTuple):
    """A topic, and the name and schema of its messages."""

    topic: str
    name: str
    schema: Schema


def channel_schemas(
    compiled: Compiled, clients: dict[str, tuple[str, ...]], heard: Collection[str] = ()
) -> tuple[ChannelSchema, ...]:
    """Return every channel of a recording.

    Args:
        compiled: the program.
        clients: each actuator's modules, highest priority first.
        heard: the actuators that another controller commands.
    """
    channels = [
        ChannelSchema(FRAMES, "colony.Frame", _frame(compiled)),
        ChannelSchema(KEYFRAMES, "colony.Keyframe", _keyframe()),
    ]
    for actuator in compiled.robot.actuators:
        modules = clients.get(actuator.name, ())
        channels += [
            ChannelSchema(
                VERDICTS + actuator.name, f"colony.Verdict.{actuator.name}", _verdict(actuator, modules)
            ),
            ChannelSchema(
                REQUESTS + actuator.name, f"colony.Requests.{actuator.name}", _requests(actuator, modules)
            ),
        ]
        if actuator.name in heard:
            channels.append(
                ChannelSchema(HEARD + actuator.name, f"colony.Heard.{actuator.name}", _heard(actuator))
            )
    return (*channels, ChannelSchema(CONTRACTS, "colony.Contracts", _contracts(compiled)))


def _object(description: str, required: tuple[str, ...] = (), /, **properties: Schema) -> Schema:
    schema: Schema = {"type": "object", "description": description, "properties": properties}
    return {**schema, "required": list(required)} if required else schema


def _scalar(kind: str, description: str) -> Schema:
    return {"type": kind, "description": description}


def _texts(description: str) -> Schema:
    return {"type": "array", "description": description, "items": {"type": "string"}}


_K = _scalar("integer", "number of the frame")


def _frame(compiled: Compiled) -> Schema:
    return _object(
        "the readings of a frame",
        ("k", "t", "t_ns", "sensors"),
        k=_K,
        t=_scalar("number", "time of the frame in s"),
        t_ns=_scalar("integer", "the same in ns, exactly"),
        start=_scalar("integer", "the first frame of the epoch"),
        previous=_scalar("integer", "number of the frame before, if a restarted Clock left numbers out"),
        restart=_scalar("boolean", "all memory restarted with this frame"),
        restarted=_scalar("boolean", "value of `restarted` in the program"),
        skipped=_scalar("integer", "if memory is unknown: frames before this one that could not be observed"),
        down=_texts("servers that are down"),
        lost=_texts("clients that are lost"),
        python=_object(
            "answers of modules in Python; absent if unknown",
            **{module: _answer() for module in compiled.python_modules},
        ),
        sensors=_object(
            "readings in declared units; absent if missing",
            **{s.name: _sensor(s) for s in compiled.robot.sensors},
        ),
        disagreements=_texts(
            "differences of verdicts from the client list that no late or lost client excuses"
        ),
    )


def _answer() -> Schema:
    command: Schema = {
        "type": "array",
        "description": "the fields of its command in base units; absent if it is not applicable",
        "items": {"type": "number"},
    }
    return _object("", command=command, error=_scalar("boolean", "it raised, or gave no command"))


def _keyframe() -> Schema:
    memory = _object(
        "the program's memory; absent if unknown",
        ("cells",),
        first_ns=_scalar("integer", "time of the first frame of the epoch; absent if there was none"),
        cells={**_object("memory cells by name"), "additionalProperties": True},
    )
    return _object(
        "memory before a frame, from which a reader resumes after damage",
        ("k", "n"),
        k=_K,
        n=_scalar("integer", "number of the keyframe"),
        memory=memory,
        degraded=_scalar("boolean", "a client has been lost since the epoch began"),
    )


def _verdict(actuator: Actuator, modules: tuple[str, ...]) -> Schema:
    return _object(
        f"verdict on a frame of {actuator.name}",
        ("k",),
        k=_K,
        by=_scalar("string", "client of the network that won; absent if none did"),
        values=_values(actuator, "command that was sent, in declared units; absent if none was sent"),
        fates=_object("fate of each client's request", **{m: _scalar("string", "") for m in modules}),
        fault=_scalar(
            "string", "reason why the idle command was sent in the place of the winner's or the connection's"
        ),
        violation=_scalar("boolean", "two clients commanded in one frame"),
        outside=_scalar(
            "string", "connection outside the network whose command was sent or, with a fault, was not"
        ),
        unlimited=_scalar("boolean", "the limits did not hold for that connection"),
        hold=_scalar("string", "reason why the network did not decide: stopped or locked"),
        notes=_texts("problems with requests"),
    )


def _requests(actuator: Actuator, modules: tuple[str, ...]) -> Schema:
    bid = _object(
        "request of a client",
        ("bid",),
        bid=_scalar("string", "command, suppressed, inhibited, inactive or silent"),
        values=_values(actuator, "command, limited and clamped, in declared units"),
        fault=_scalar("string", "reason why the command has no values"),
    )
    clients = _object("by client", **dict.fromkeys(modules, bid))
    return _object(f"requests of the clients of {actuator.name}", ("k",), k=_K, clients=clients)


def _heard(actuator: Actuator) -> Schema:
    return _object(
        f"command of another controller for {actuator.name}",
        ("k", "values", "age_ns"),
        k=_K,
        values=_values(actuator, "command, in declared units"),
        age_ns=_scalar("integer", "its age in ns"),
    )


def _contracts(compiled: Compiled) -> Schema:
    names = ", ".join(c.name for c in compiled.contracts) or "there are none"
    broken = _texts(f"broken contracts, of: {names}")
    heard = _texts("contracts that the commands of another controller broke")
    return _object("frames in which contracts were broken", ("k", "broken"), k=_K, broken=broken, heard=heard)


def _values(actuator: Actuator, description: str) -> Schema:
    return _object(description, **{f.name: _field(f) for f in actuator.fields})


def _field(field: ActuatorField) -> Schema:
    return _scalar(_json_type(field.type), field.unit)


def _sensor(sensor: Sensor) -> Schema:
    origin = f"from {sensor.server}.{sensor.field}"
    description = f"{sensor.unit}, {origin}" if sensor.unit else origin
    if isinstance(sensor.type, Array):
        items = {"type": _json_type(sensor.type.element)}
        return {"type": "array", "description": f"{sensor.type.size} values, {description}", "items": items}
    return _scalar(_json_type(sensor.type), description)


def _json_type(type_: Scalar) -> str:
    return "boolean" if isinstance(type_, Bool) else "number"
