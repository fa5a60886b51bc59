"""Resolution of `last.ACTUATOR.FIELD`: what an actuator was given in the frame before."""

from __future__ import annotations

from colony.dsl import ast
from colony.dsl.check.checker import Checker
from colony.dsl.check.scope import ActuatorSymbol, BrokenSymbol
from colony.ir import program as ir


def sent_field(checker: Checker, node: ast.Reference) -> ir.Sensor | None:
    """Return the sensor `last.ACTUATOR.FIELD` of the program, or None after reporting an error."""
    robot = checker.scope.robot
    if len(node.path) != 3:
        actuator = min(robot.actuator_names, default="ACTUATOR")
        if len(node.path) > 1 and node.path[1] in robot.actuator_names:
            actuator = node.path[1]
        hint = f"name an actuator and one of its fields: `last.{actuator}.FIELD`"
        checker.error("E108", node, f"`{node.text}` is no field of an actuator", hint)
        return None
    _, name, field = node.path
    symbol = robot.network_symbols.get(name)
    if not isinstance(symbol, ActuatorSymbol):
        if not isinstance(symbol, BrokenSymbol) and not checker.scope.may_be_lost(name):
            similar = checker.report.suggest(name, robot.actuator_names)
            checker.error("E402", node, f"unknown actuator `{name}`", similar)
        return None
    fields = [f.name for f in symbol.actuator.fields]
    if field not in fields:
        shown = checker.report.suggest(field, fields) or f"it has {', '.join(fields)}"
        checker.error("E108", node, f"actuator `{name}` has no field `{field}`", shown)
        return None
    sensor = ir.sent_sensor(symbol.actuator, fields.index(field))
    return robot.sent.setdefault(sensor.name, sensor)
