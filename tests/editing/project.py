"""A project of a robot and a behavior, open in an editor."""

from __future__ import annotations

from pathlib import Path

from colony.editing.open_file import uri_of
from tests.editing.client import NearEditor

ROBOT = """language 1

# The robot of these tests.
robot rome {
  sensor   sonar[24] : mm  bearing -180 deg  range 0 .. 10000  from PServer.sonar  within 300 ms
  sensor   bumper    : bool                  from RServer.bumper within 300 ms
  sensor   paused    : bool  default false   from DServer.Paused
  actuator drive { velocity : mm/s range -600 .. 600, turn : deg/s range -90 .. 90 }
           to RServer.drive  idle drive(velocity = 0, turn = 0)
}
"""

PATROL = """language 1

import robot

enum goal { none = 0, light = 2 }
param room = 2 * 450 mm
# What is straight ahead.
let ahead = min(sonar[-30 deg .. 30 deg])
let near(r : mm, limit : mm = 900 mm) = r < limit
state bumps = 0
next  bumps = if rising(bumper) then bumps + 1 else bumps
machine mode { start roaming  roaming -> resting when bumper  resting -> roaming when not bumper }

module cruise {
  param speed = 400 mm/s
  when mode == mode.roaming
  do   drive(velocity = speed, turn = 0)
}
module gentle = cruise(speed = 100 mm/s)

# Turns away from what is near.
failsafe module avoid {
  let  close = near(ahead, limit = room)
  when close
  do   drive(velocity = 60 mm/s, turn = if sonar[90 deg] > sonar[-90 deg] then 30 deg/s else -30 deg/s)
}
module pause { when paused }

network {
  roam  = avoid suppresses gentle suppresses cruise
  drive = pause inhibits roam
}

contract slow: drive by avoid implies drive.velocity <= 100 mm/s
reach turns: drive.turn > 0

test "avoids what is near" {
  at 0 s  given sonar = 3 m, bumper = false, sonar[0 deg] = 400 mm  expect drive by avoid, avoid.close
}
"""


class Project(NearEditor):
    """An editor with a project of a robot and a behavior."""

    def __init__(self, folder: Path, *, prove: bool = False) -> None:
        super().__init__()
        self.folder = folder.resolve()
        (folder / "robots" / "rome").mkdir(parents=True)
        (folder / "robots" / "rome" / "rome.colony").write_text(ROBOT)
        (folder / "colony.toml").write_text('robot = "rome"\n')
        self.path = self.folder / "patrol.colony"
        self.path.write_text(PATROL)
        self.initialize(self.folder, prove=prove)
        self.uri = self.open(self.path)

    @property
    def robot_uri(self) -> str:
        return uri_of(str(self.folder / "robots" / "rome" / "rome.colony"))
