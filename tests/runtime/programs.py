"""Small programs, built by hand, for the tests of the runtime."""

from __future__ import annotations

from colony.ir.expression import (
    Binary,
    BinaryOperation,
    Constant,
    Expression,
    Function,
    FunctionCall,
    MemoryCall,
    MemoryFunction,
    SensorValue,
    SentField,
    Unary,
    UnaryOperation,
)
from colony.ir.program import (
    Actuator,
    ActuatorField,
    Chain,
    Contract,
    Module,
    Program,
    Robot,
    Sensor,
    TransferFunction,
    Use,
    Wire,
)
from colony.ir.servers import SPEED, TURN_RATE
from colony.ir.types import BOOL, DIMENSIONLESS, DISTANCE, Array, Value

SONAR = Array(DISTANCE, 24)


def number(value: float) -> Constant:
    return Constant(type=DIMENSIONLESS, value=value)


def constant(value: Value) -> Constant:
    return Constant(type=BOOL if isinstance(value, bool) else DIMENSIONLESS, value=value)


def nearest() -> Expression:
    return FunctionCall(
        type=DISTANCE, function=Function.MIN, arguments=(SensorValue(type=SONAR, name="sonar"),)
    )


def less(left: Expression, right: float) -> Expression:
    return BinaryOperation(type=BOOL, operator=Binary.LESS, left=left, right=number(right))


def robot(*extra: Sensor, frame_ms: int = 50, actuators: tuple[Actuator, ...] = ()) -> Robot:
    return Robot(
        name="rome",
        frame_ns=frame_ms * 1_000_000,
        sensors=(
            Sensor(
                name="sonar",
                type=SONAR,
                low=0.0,
                high=10_000.0,
                server="PServer",
                field="sonar",
                within_ns=300_000_000,
            ),
            Sensor(name="bumper", type=BOOL, server="RServer", field="bumper"),
            Sensor(name="chance", type=DIMENSIONLESS, server="Runtime", field="random"),
            *extra,
        ),
        actuators=(drive(), *actuators),
    )


def drive() -> Actuator:
    return Actuator(
        name="drive",
        fields=(
            ActuatorField(name="velocity", type=SPEED, low=-600.0, high=600.0),
            ActuatorField(name="turn", type=TURN_RATE, low=-90.0, high=90.0),
        ),
        server="RServer",
        command="drive",
        idle=(0.0, 0.0),
    )


def go(velocity: float, turn: float) -> TransferFunction:
    return TransferFunction(actuator="drive", fields=(number(velocity), number(turn)))


def roam(**changes: object) -> Program:
    """back_off suppresses (asleep inhibits (avoid suppresses cruise)), and a contract that can break."""
    bumper = SensorValue(type=BOOL, name="bumper")
    held = MemoryCall(
        type=BOOL, function=MemoryFunction.RECENTLY, arguments=(bumper,), cell=0, duration_ns=1_000_000_000
    )
    still = BinaryOperation(
        type=BOOL,
        operator=Binary.LESS_EQUAL,
        left=SentField(type=SPEED, actuator="drive", field_index=0),
        right=number(0.0),
    )
    fields: dict[str, object] = {
        "robot": robot(),
        "modules": (
            Module(name="cruise", when=constant(True), command=go(300.0, 0.0)),
            Module(name="avoid", when=less(nearest(), 700.0), command=go(60.0, 45.0)),
            Module(name="back_off", when=held, command=go(-200.0, 20.0)),
            Module(name="asleep", when=less(SensorValue(type=DIMENSIONLESS, name="chance"), 0.1)),
        ),
        "wires": (
            Wire(
                name="drive",
                actuator="drive",
                wiring=Chain(
                    relation="suppresses",
                    operands=(
                        Use(name="back_off"),
                        Chain(
                            relation="inhibits",
                            operands=(
                                Use(name="asleep"),
                                Chain(
                                    relation="suppresses",
                                    operands=(Use(name="avoid"), Use(name="cruise")),
                                    windows_ns=(0,),
                                ),
                            ),
                            windows_ns=(0,),
                        ),
                    ),
                    windows_ns=(0,),
                ),
            ),
        ),
        "contracts": (
            Contract(
                name="never_ram",
                expression=BinaryOperation(type=BOOL, operator=Binary.IMPLIES, left=bumper, right=still),
            ),
        ),
    }
    return Program(**(fields | changes))  # type: ignore[arg-type]


def negated(expression: Expression) -> Expression:
    return UnaryOperation(type=BOOL, operator=Unary.NOT, operand=expression)
