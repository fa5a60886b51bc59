"""What the units of a Pioneer mean, and where its sonars are: a row for each model.

Source: the parameter files that ARIA reads (AriaCoda, params/*.p), as numbers.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple


class SonarPose(NamedTuple):
    """The pose of a sonar: mm ahead and to the left of the turning center, degrees counterclockwise."""

    x: int
    y: int
    bearing: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Parameters:
    """What the numbers of a model mean.

    Attributes:
        model: the subclass in its answer to SYNC2.
        distance, speed, range: mm, mm/s and mm for a unit of positions, wheel speeds and sonar ranges.
        turn_units: units of the heading in a full turn.
        turn_per_speed: turning speed in rad/s for 1 mm/s, of half the difference of the wheels' speeds.
        max_speed, max_turn: greatest speeds in mm/s and deg/s.
        front_bumpers, rear_bumpers: segments that the model comes with.
        sonars: poses of the sonars, by number.
    """

    model: str
    distance: float
    speed: float
    range: float
    turn_units: int
    turn_per_speed: float
    max_speed: int
    max_turn: int
    front_bumpers: int
    rear_bumpers: int
    sonars: tuple[SonarPose, ...]

    def turn_rate(self, left: float, right: float) -> float:
        """Return the turning speed in deg/s at these speeds of the wheels, in mm/s."""
        return math.degrees((right - left) / 2.0 * self.turn_per_speed)


def parameters_of(model: str) -> Parameters | None:
    """Return the row of a model; the case of letters does not count. None if there is none."""
    return MODELS.get(model.casefold())


def _poses(*poses: tuple[int, int, int]) -> tuple[SonarPose, ...]:
    return tuple(SonarPose(*pose) for pose in poses)


def _arc(*half: tuple[int, int, int]) -> tuple[SonarPose, ...]:
    """Return the poses of an arc from those of one side, beginning at its end."""
    return _poses(*half) + tuple(SonarPose(x, -y, -bearing) for x, y, bearing in reversed(half))


_FRONT = _arc((69, 136, 90), (114, 119, 50), (148, 78, 30), (166, 27, 10))
_REAR = _arc((-157, -136, -90), (-203, -119, -130), (-237, -78, -150), (-255, -27, -170))
_TOP_FRONT = _arc((-20, 136, 90), (24, 119, 50), (58, 78, 30), (77, 27, 10))
_TOP_REAR = _arc((-191, -136, -90), (-237, -119, -130), (-271, -78, -150), (-290, -27, -170))
_CENTER = _poses((0, 0, -180))  # no transducer is there: the place in the row is kept free
_POWER_FRONT = (
    _poses((152, 278, 90), (200, 267, 65), (241, 238, 45), (274, 200, 35))
    + _poses((300, 153, 25), (320, 96, 15), (332, 33, 5))
    + _CENTER
    + _poses((332, -33, -5), (320, -96, -15), (300, -153, -25))
    + _poses((274, -200, -35), (241, -238, -45), (200, -267, -65), (152, -278, -90))
)
_POWER_REAR = (
    _poses((-298, -278, -90), (-347, -267, -115), (-388, -238, -135), (-420, -200, -145))
    + _poses((-447, -153, -155), (-467, -96, -165), (-478, -33, -175))
    + _CENTER
    + _poses((-478, 33, 175), (-467, 96, 165), (-447, 153, 155))
    + _poses((-420, 200, 145), (-388, 238, 135), (-347, 267, 115), (-298, 278, 90))
)

_AMIGO_REAR = (-145, 145)

LAYOUTS = {
    "none": (),
    "dx": _FRONT + _REAR,
    "at": _arc((147, 136, 90), (193, 119, 50), (227, 79, 30), (245, 27, 10))
    + _arc((-144, -136, -90), (-189, -119, -130), (-223, -79, -150), (-241, -27, -170)),
    "amigo": _arc((76, 100, 90), (125, 75, 41), (150, 30, 15)) + _poses((-140, -58, -145), (-140, 58, 145)),
    "amigo-sh": _poses((70, 100, 90), (125, 75, 41), (144, 30, 15), (144, -30, -15))
    + _poses((120, -75, -41), (70, -100, -90), (-146, -58, -145), (-146, 58, 145)),
    "patrol": _arc((83, 229, 90), (169, 202, 55), (232, 134, 30), (263, 46, 10))
    + _arc((-83, -229, -90), (-169, -202, -125), (-232, -134, -150), (-263, -46, -170)),
    "lx": _poses((331, 61, 10), (331, -61, -10), (-317, 90, 164), (-317, -90, -164)),
    "pion": _poses((100, 100, 90), (120, 80, 30), (130, 40, 15), (130, 0, 0))
    + _poses((130, -40, -15), (120, -80, -30), (100, -100, -90)),
    "p2pb": _FRONT + _TOP_FRONT + _REAR,
    "people": _FRONT + _REAR + _TOP_FRONT + _TOP_REAR,
    "perf": _FRONT + _TOP_FRONT + _REAR + _TOP_REAR,
    "power": _POWER_FRONT + _CENTER + _POWER_REAR + _CENTER,
    "power-31": _POWER_FRONT + _CENTER + _POWER_REAR,
    "uarcs": _POWER_REAR + _CENTER,
}
"""Poses of sonars, which several models share."""

# model; units of distance (mm), speed (mm/s), range (mm), turn; rad/s for 1 mm/s; most mm/s and deg/s;
# bumpers in front and behind; sonars
_TABLE = """
amigo                0.5083 0.6154      1 4096   0.011 1000 300 0 0  amigo
amigo-sh                  1      1      1 4096   0.011 1000 300 0 0  amigo-sh
amigo-sh-tim3xx           1      1      1 4096   0.011 1000 300 0 0  amigo-sh
mt400                     1      1      1 4096  0.0056 2200 500 6 6  patrol
p2at                   1.32      1  0.268 4096  0.0034 1200 300 0 0  at
p2at8                  1.32      1      1 4096  0.0034 1200 300 0 0  at
p2at8+                0.465      1      1 4096  0.0034 1200 300 0 0  at
p2ce                  0.826      1  0.268 4096  0.0057 2200 500 0 0  dx
p2d8                  0.485      1      1 4096  0.0056 2200 500 0 0  dx
p2d8+                 0.485      1      1 4096  0.0056 2200 500 0 0  dx
p2de                  0.969      1  0.268 4096  0.0056 2200 500 0 0  dx
p2df                  0.485      1  0.268 4096   0.006 2200 500 0 0  dx
p2dx                   0.84      1  0.268 4096  0.0056 2200 500 0 0  dx
p2it                  1.136      1  0.268 4096  0.0032 1200 300 0 0  at
p2pb                  0.424      1  0.268 4096  0.0056 2200 500 5 5  p2pb
p2pp                  0.485      1  0.268 4096   0.006 2200 500 5 5  p2pb
p3at                  0.465      1      1 4096  0.0034 1200 300 0 0  at
p3at-sh                   1      1      1 4096  0.0034 1200 300 0 0  at
p3at-sh-lms1xx            1      1      1 4096  0.0034 1200 300 0 0  at
p3at-sh-lms500            1      1      1 4096  0.0034 1200 300 0 0  at
p3atiw-sh                 1      1      1 4096  0.0034 1200 300 0 0  at
p3dx                  0.485      1      1 4096  0.0056 2200 500 0 0  dx
p3dx-sh                   1      1      1 4096  0.0056 2200 500 0 0  dx
p3dx-sh-lms1xx            1      1      1 4096  0.0056 2200 500 0 0  dx
p3dx-sh-lms500            1      1      1 4096  0.0056 2200 500 0 0  dx
patrolbot-sh              1      1      1 4096  0.0056 2200 500 6 6  patrol
peoplebot-sh              1      1      1 4096   0.006 2200 500 5 5  people
peoplebot-sh-lms1xx       1      1      1 4096   0.006 2200 500 5 5  people
peoplebot-sh-lms500       1      1      1 4096   0.006 2200 500 5 5  people
perfpb                0.485      1      1 4096   0.006 2200 500 5 5  perf
perfpb+               0.485      1      1 4096   0.006 2200 500 5 5  perf
pion1m              0.05066 2.5332 0.1734 1024 0.00333  400 100 0 0  pion
pion1x              0.05066 2.5332 0.1734 1024 0.00333  400 100 0 0  pion
pionat                 0.07 2.5332 0.1734 1024 0.00333  500 100 0 0  pion
pioneer-lx                1      1      1 4096  0.0056 2500 180 3 3  lx
pioneer-lx-ld             1      1      1 4096  0.0056 2500 180 3 3  lx
powerbot             0.5813      1      1 4096 0.00373 2000 360 7 5  power-31
powerbot-sh               1      1      1 4096 0.00373 2000 360 7 5  power
powerbot-sh-lms500        1      1      1 4096 0.00373 2000 360 7 5  power
powerbot-sh-uarcs         1      1      1 4096 0.00373 2000 360 7 5  uarcs
psos1m              0.05066 2.5332 0.1734 1024 0.00333  400 100 0 0  pion
psos1x              0.05066 2.5332 0.1734 1024 0.00333  400 100 0 0  pion
psos43m             0.05066 2.5332 0.1734 1024 0.00333  400 100 0 0  pion
researchPB                1      1      1 4096  0.0056 2200 500 6 6  patrol
researchPB-lms500         1      1      1 4096  0.0056 2200 500 6 6  patrol
seekur                    1      1      1 4096  0.0056 2200 190 5 3  none
seekurjr                  1      1      1 4096  0.0056 1200  80 4 4  none
wheelchair-sh             1      1      1 4096 0.00373 2000 360 4 3  none
"""


def _row(line: str) -> Parameters:
    model, distance, speed, range_, units, per_speed, max_speed, max_turn, front, rear, layout = line.split()
    return Parameters(
        model=model,
        distance=float(distance),
        speed=float(speed),
        range=float(range_),
        turn_units=int(units),
        turn_per_speed=float(per_speed),
        max_speed=int(max_speed),
        max_turn=int(max_turn),
        front_bumpers=int(front),
        rear_bumpers=int(rear),
        sonars=LAYOUTS[layout],
    )


MODELS = {row.model.casefold(): row for row in map(_row, _TABLE.strip().splitlines())}
"""The rows of all models."""
