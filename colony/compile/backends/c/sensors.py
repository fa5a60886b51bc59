"""The sensors of a frame in C: the members of its struct, and the statements that take its readings."""

from __future__ import annotations

from colony.compile.backends.c.expressions import literal
from colony.compile.backends.python.text import UniqueNames
from colony.execute.sensors import members, stand_in
from colony.ir.program import Sensor
from colony.ir.types import Array, Bool, element_type


def sensor_members(sensor: Sensor, member: str) -> list[str]:
    """Return the lines of a sensor in the struct of a frame."""
    size = f"[{sensor.type.size}]" if isinstance(sensor.type, Array) else ""
    unit = f" /* {sensor.unit} */" if sensor.unit else ""
    lines = ["    struct {", f"        {_type(sensor)} value{size};{unit}"]
    lines += ["        uint8_t given; /* enum colony_given */"]
    if sensor.within_ns is not None:
        lines += ["        int64_t taken_ns; /* when the reading was taken */"]
    return [*lines, f"    }} {member};"]


def sensor_lines(sensor: Sensor, index: int, member: str, names: UniqueNames, used: set[str]) -> list[str]:
    """Return the statements that set a sensor's value (or stand-in) and its freshness."""
    name, array = names.sensors[sensor.name], isinstance(sensor.type, Array)
    given, reading = f"f->{member}.given", f"f->{member}.value"
    lines = []
    if sensor.within_ns is not None:
        given = f"colony_aged({given}, f->t_ns, f->{member}.taken_ns, INT64_C({sensor.within_ns}))"
    if sensor.sent is not None:
        kept = f"m->{names.last[sensor.name]}"
        own = f"{given} == COLONY_ABSENT && {kept}.known"
        given, reading = f"{own} ? COLONY_GIVEN : {given}", f"{own} ? {kept}.value : {reading}"
    lines.append(
        f"{_type(sensor)} {name}{f'[{sensor.type.size}]' if isinstance(sensor.type, Array) else ''};"
    )
    arguments = [name if array else f"&{name}", f"&out->found[{index}]", given, reading]
    if isinstance(sensor.type, Array):
        arguments.append(str(sensor.type.size))
    numbers, otherwise = members(sensor), stand_in(sensor)
    kind = (
        "bool" if isinstance(element_type(sensor.type), Bool) else "number" if numbers is None else "member"
    )
    if numbers is not None:
        listed = ", ".join(literal(x).text for x in numbers)
        arguments += [f"(const double[]){{{listed}}}", str(len(numbers))]
    elif kind == "number":
        low = float("-inf") if sensor.low is None else sensor.low
        high = float("inf") if sensor.high is None else sensor.high
        arguments += [literal(x).text for x in (sensor.factor, low, high)]
    arguments.append(literal(otherwise[0] if isinstance(otherwise, tuple) else otherwise).text)
    call = f"colony_{kind}{'s' if array else ''}({', '.join(arguments)});"
    fresh = names.fresh[sensor.name]
    return [*lines, f"const bool {fresh} = {call}" if fresh in used else f"(void){call}"]


def _type(sensor: Sensor) -> str:
    return "bool" if isinstance(element_type(sensor.type), Bool) else "double"
