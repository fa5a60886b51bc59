"""The task layer: from a goal to a heading and a speed, by a state machine.

    python examples/hierarchy/task.py --robot layered

It watches the goal, which the mission layer sets, and where the robot is, which the control layer tells in
every frame. Each time one of them changes it says anew which way to go and how fast. It needs no clock of its
own: when nobody tells where the robot is any more, it has nothing to say either, and the control layer
stands.
"""

from __future__ import annotations

import argparse
import math
from contextlib import suppress
from enum import StrEnum
from typing import NamedTuple

import msgspec

from colony.runtime.kit.connection import Connection, connect
from colony.runtime.library import data

ARRIVED_MM = 250.0
SPEED_MM_S = 400.0
AIMED_DEG = 10.0


class Goal(msgspec.Struct, frozen=True):
    """A place to go to; `number` tells goals apart."""

    number: int
    x: float
    y: float


class Pose(NamedTuple):
    """Where the robot is, in mm and degrees counterclockwise from north."""

    x: float
    y: float
    heading: float


class State(StrEnum):
    WAITING = "waiting"
    TURNING = "turning"
    DRIVING = "driving"
    ARRIVED = "arrived"


class Told(NamedTuple):
    """What the control layer is told."""

    heading: float
    speed: float


def step(state: State, goal: Goal, pose: Pose) -> tuple[State, Told]:
    """The next state, and what to do in it. A new goal begins in `WAITING`."""
    dx, dy = goal.x - pose.x, goal.y - pose.y
    heading = math.degrees(math.atan2(-dx, dy)) % 360.0
    off = abs((heading - pose.heading + 180.0) % 360.0 - 180.0)
    if state is State.ARRIVED or math.hypot(dx, dy) < ARRIVED_MM:
        return State.ARRIVED, Told(pose.heading, 0.0)
    if state is State.DRIVING or off < AIMED_DEG:
        return State.DRIVING, Told(heading, SPEED_MM_S)
    return State.TURNING, Told(heading, 0.0)


def run(layers: Connection) -> None:
    """Turn goals into headings and speeds, as long as there are news."""
    layers.keep(data.watch("Goal", "Pose"))
    goal: Goal | None = None
    pose: Pose | None = None
    state = State.WAITING
    for notice in layers.notices():
        present = data.change(notice).present
        if notice.subject == "Goal":
            goal, state = (None if present is None else present.read(Goal)), State.WAITING
        elif present is not None:
            pose = present.read(Pose)
        if goal is None or pose is None:
            continue
        before = state
        state, told = step(state, goal, pose)
        news: dict[str, object] = {"TaskHeading": told.heading, "TaskSpeed": told.speed}
        if state is not before:
            news["TaskState"] = state
            if state is State.ARRIVED:
                news["Arrived"] = goal.number
        layers.do(data.set_many(news))


def main() -> None:
    """The entry of the program."""
    parser = argparse.ArgumentParser(description="The task layer.")
    parser.add_argument("--robot", required=True, help="the robot's name")
    with connect("DServer", robot=parser.parse_args().robot, name="task layer") as layers:
        run(layers)


if __name__ == "__main__":
    with suppress(KeyboardInterrupt):
        main()
