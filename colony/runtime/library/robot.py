"""Calls of RServer: move the base, read its state, lock it (thesis section 4.6.3, Table 4.1).

`give_way`, `lock`, `unlock` and `ignore_limits` are those of `library/actuator.py`. For the emergency stop
see `library/emergency.py`.

    connection.do(robot.move(1500, velocity=250))
    where = connection.do(robot.position())

Distances are in mm, angles in degrees, times in seconds; speeds and accelerations accordingly. Arguments in
degrees (`turn`, `continuous_turn`, `jog`) are positive clockwise, as in the thesis, and decrease the heading,
which increases counterclockwise; `drive` takes turning speeds as programs do, positive counterclockwise.

Commands that move the base are arbitrated by the connection's priority. During a run, a connection whose
priority is above that of the modules drives instead of them; one below them drives only while they are idle.
A priority that a client or another connection already has is refused with the code "tie". `drive`, `go`,
`jog` and `stop` stay in force until their lease ends, unless they are repeated; other motions, until they are
done. Other codes: "stopped" while the emergency stop is on; "locked" while another connection has the lock;
"replaced", "bumper", "stalled" and "limits" for motions that ended early.

Commands are held, frame by frame, to the limits of the program that runs, unless the connection ignores them
(`ignore_limits`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import msgspec

from colony.runtime.arbitration.motion import Mode, MotionCall, Speeds
from colony.runtime.library.actuator import LEASE_S, ClientReport
from colony.runtime.library.actuator import give_way as give_way
from colony.runtime.library.actuator import ignore_limits as ignore_limits
from colony.runtime.library.actuator import lock as lock
from colony.runtime.library.actuator import unlock as unlock
from colony.runtime.library.ask import CallRequest
from colony.runtime.protocol.calls import NoArguments
from colony.runtime.protocol.messages import Stopped

if TYPE_CHECKING:
    from colony.runtime.protocol.deployment import Deployment

KEEP_SETTING = -1.0
"""Argument for a velocity or acceleration that keeps the value set last."""

MOTION_WAIT_S = 3600.0
"""Timeout in seconds of a call that waits for the end of a motion."""


# --- arguments -------------------------------------------------------------------------------------


class Drive(msgspec.Struct, frozen=True, kw_only=True):
    """Arguments of `drive`: forward mm/s, deg/s counterclockwise and mm/s to the left, for `lease_s`."""

    velocity: float
    turn: float
    lease_s: float = LEASE_S
    sideways: float = 0.0


class GoArguments(msgspec.Struct, frozen=True, kw_only=True):
    """Arguments of `go` and `proportional_go`: straight ahead at `velocity`, backward if negative."""

    velocity: float
    lease_s: float = LEASE_S


class JogArguments(msgspec.Struct, frozen=True, kw_only=True):
    """Arguments of `jog`: deg/s clockwise on top of the forward motion."""

    rate: float
    lease_s: float = LEASE_S


class HaltArguments(msgspec.Struct, frozen=True, kw_only=True):
    """Arguments of `stop`: gradually if `mode` is 0, else immediately; then stand still for `lease_s`."""

    mode: int = 0
    lease_s: float = LEASE_S


class MoveArguments(msgspec.Struct, frozen=True, kw_only=True):
    """Arguments of `move`: a distance straight ahead; negative is backward.

    A negative velocity or acceleration keeps the one set last. With `wait`, the answer comes when the motion
    is done.
    """

    distance: float
    velocity: float = KEEP_SETTING
    acceleration: float = KEEP_SETTING
    wait: bool = True


class TurnArguments(msgspec.Struct, frozen=True, kw_only=True):
    """Arguments of `turn`: degrees clockwise on the spot, in deg/s and deg/s^2; else as `MoveArguments`."""

    degrees: float
    velocity: float = KEEP_SETTING
    acceleration: float = KEEP_SETTING
    wait: bool = True


class ContinuousTurn(msgspec.Struct, frozen=True, kw_only=True):
    """Arguments of `continuous_turn`: degrees clockwise along an arc, at mm/s; else as `MoveArguments`."""

    degrees: float
    radius: float
    velocity: float = KEEP_SETTING
    acceleration: float = KEEP_SETTING
    wait: bool = True


class PoseArguments(msgspec.Struct, frozen=True, kw_only=True):
    """Arguments of `set_position` and `adjust_position`: x, y and heading, or corrections of them."""

    x: float
    y: float
    heading: float


class SetBumper(msgspec.Struct, frozen=True, kw_only=True):
    """Arguments of `set_bumper`: 0 to ignore the bumpers, any other value to watch them."""

    setting: int


# --- replies ---------------------------------------------------------------------------------------


class Bumpers(msgspec.Struct, frozen=True, kw_only=True):
    """The state of the bumpers: True for one that touches something."""

    front: bool
    rear: bool

    @property
    def code(self) -> int:
        """The code of the thesis: 0 for none, 1 for the front bumper, 2 for the rear one, 3 for both."""
        return self.front + 2 * self.rear


class Position(msgspec.Struct, frozen=True, kw_only=True):
    """Dead reckoning at `t_ns` of the robot's time: x east, y north, heading in [0, 360), 90 is west."""

    x: float
    y: float
    heading: float
    t_ns: int


class BaseActuatorReport(msgspec.Struct, frozen=True, kw_only=True):
    """An actuator of the program: its clients, highest priority first, and its newest note."""

    name: str
    frames: int
    clients: tuple[ClientReport, ...]
    last_note: str | None


class BaseOutsideReport(msgspec.Struct, frozen=True, kw_only=True):
    """A connection that has commanded the base, whose priority is therefore taken.

    `commands` is the call by which it commands now, None if there is none. `lease_s` is the remaining time of
    the command's lease, None for a motion that ends when it is done. `unlimited` is True if the connection
    ignores the limits of the program.
    """

    connection: str
    name: str
    priority: int
    commands: MotionCall | None
    lease_s: float | None
    unlimited: bool = False


class BaseArbitration(msgspec.Struct, frozen=True, kw_only=True):
    """The clients and connections that may move the base, and the one that does so.

    `run` is "" if no program is deployed; `leader` is the connection that deployed it; `acting` is the client
    or connection that commanded the base in the newest frame. `outside` is in the order of priorities,
    `lock_waiting` in the order in which connections will get the lock. `sent` are the speeds that were sent
    last; `low` and `high` are the ends of what `drive` takes now.
    """

    run: str
    leader: str | None
    acting: str | None
    actuators: tuple[BaseActuatorReport, ...]
    outside: tuple[BaseOutsideReport, ...]
    lock_holder: str | None
    lock_waiting: tuple[str, ...]
    stopped: Stopped | None
    sent: Speeds
    low: Speeds
    high: Speeds


# --- calls -----------------------------------------------------------------------------------------


def drive(
    velocity: float, turn: float, lease: float = LEASE_S, *, sideways: float = 0.0
) -> CallRequest[None]:
    """Drive at `velocity` mm/s, turning `turn` deg/s counterclockwise, for `lease` s or until replaced.

    A base that drives sideways also moves at `sideways` mm/s to the left; others refuse any but 0.
    """
    return _command("drive", Drive(velocity=velocity, turn=turn, lease_s=lease, sideways=sideways))


def go(velocity: float, lease: float = LEASE_S) -> CallRequest[None]:
    """Go straight ahead, holding the heading by proportional-integral control (`ROBOT_GO`)."""
    return _command("go", GoArguments(velocity=velocity, lease_s=lease))


def proportional_go(velocity: float, lease: float = LEASE_S) -> CallRequest[None]:
    """Go straight ahead, holding the heading by proportional control only."""
    return _command("proportional_go", GoArguments(velocity=velocity, lease_s=lease))


def jog(rate: float, lease: float = LEASE_S) -> CallRequest[None]:
    """Turn at `rate` deg/s, positive clockwise, on top of this connection's forward motion (`ROBOT_JOG`)."""
    return _command("jog", JogArguments(rate=rate, lease_s=lease))


def stop(mode: int = 0, lease: float = LEASE_S) -> CallRequest[None]:
    """Stop, gradually if `mode` is 0, else immediately, and stand still for `lease` s (`ROBOT_STOP`).

    Like every command, it is arbitrated by the connection's priority. To stop in any case, use
    `emergency.stop`.
    """
    return _command("stop", HaltArguments(mode=mode, lease_s=lease))


def move(
    distance: float, velocity: float = KEEP_SETTING, acceleration: float = KEEP_SETTING, wait: bool = True
) -> CallRequest[float | None]:
    """Go `distance` mm straight ahead, backward if negative, and stop (`ROBOT_MOVE`).

    With `wait`, the reply comes at the end and is the distance that the base went; else it is None.
    """
    arguments = MoveArguments(distance=distance, velocity=velocity, acceleration=acceleration, wait=wait)
    return _motion("move", arguments, wait)


def turn(
    degrees: float, velocity: float = KEEP_SETTING, acceleration: float = KEEP_SETTING, wait: bool = True
) -> CallRequest[float | None]:
    """Turn on the spot by `degrees`, positive clockwise, and stop (`ROBOT_TURN`).

    With `wait`, the reply comes at the end and is the angle that the base turned; else it is None.
    """
    arguments = TurnArguments(degrees=degrees, velocity=velocity, acceleration=acceleration, wait=wait)
    return _motion("turn", arguments, wait)


def continuous_turn(
    degrees: float,
    radius: float,
    velocity: float = KEEP_SETTING,
    acceleration: float = KEEP_SETTING,
    wait: bool = True,
) -> CallRequest[float | None]:
    """Go along an arc of `radius` mm until the base has turned by `degrees`, positive clockwise; then stop.

    With `wait`, the reply comes at the end and is the angle that the base turned; else it is None.
    """
    arguments = ContinuousTurn(
        degrees=degrees, radius=radius, velocity=velocity, acceleration=acceleration, wait=wait
    )
    return _motion("continuous_turn", arguments, wait)


def adjust_position(dx: float, dy: float, dheading: float) -> CallRequest[None]:
    """Correct the position of the base by `dx` and `dy` mm, and its heading by degrees (`ROBOT_ADJPOS`)."""
    return CallRequest("adjust_position", PoseArguments(x=dx, y=dy, heading=dheading), type(None), "command")


def set_position(x: float, y: float, heading: float) -> CallRequest[None]:
    """Set the position of the base, from which dead reckoning continues (`ROBOT_SETPOS`)."""
    return CallRequest("set_position", PoseArguments(x=x, y=y, heading=heading), type(None), "command")


def position() -> CallRequest[Position]:
    """Read the position of the base (`ROBOT_GETPOS`)."""
    return CallRequest("position", NoArguments(), Position, "read", repeatable=True)


def bumper() -> CallRequest[Bumpers]:
    """Read which bumpers touch something (`ROBOT_GETBMPR`)."""
    return CallRequest("bumper", NoArguments(), Bumpers, "read", repeatable=True)


def set_bumper(setting: int) -> CallRequest[None]:
    """Ignore the bumpers if `setting` is 0, else watch them, which is the default (`ROBOT_SETBMPR`).

    A watched bumper that is pressed stops every motion into it.
    """
    return CallRequest("set_bumper", SetBumper(setting=setting), type(None), "command", repeatable=True)


def mode() -> CallRequest[Mode]:
    """Read the mode of the base, which the last command set (`ROBOT_GETMODE`)."""
    return CallRequest("mode", NoArguments(), Mode, "read", repeatable=True)


def speed_setting() -> CallRequest[float]:
    """Read the forward speed that was sent to the base last, in mm/s (`ROBOT_GETSPEED`)."""
    return CallRequest("speed_setting", NoArguments(), float, "read", repeatable=True)


def wheel_speed() -> CallRequest[float]:
    """Read the mean of the magnitudes of the wheels' measured speeds, in mm/s (`ROBOT_GETWSPEED`)."""
    return CallRequest("wheel_speed", NoArguments(), float, "read", repeatable=True)


def arbitration() -> CallRequest[BaseArbitration]:
    """Read the clients and connections that may move the base, and the one that does so."""
    return CallRequest("arbitration", NoArguments(), BaseArbitration, "read", repeatable=True)


def deploy(deployed: Deployment) -> CallRequest[None]:
    """Let the clients of a program command the base as long as this connection is open.

    Refused with the codes "busy" while another run's leader is connected, "deployment" if the deployment is
    invalid, "tie" if a connection commands with the priority of one of its clients.
    """
    return CallRequest("deploy", deployed, type(None), "command", repeatable=True)


def _command(method: str, arguments: msgspec.Struct) -> CallRequest[None]:
    return CallRequest(method, arguments, type(None), "command")


def _motion(method: str, arguments: msgspec.Struct, wait: bool) -> CallRequest[float | None]:
    return CallRequest(method, arguments, float | None, "command", wait_s=MOTION_WAIT_S if wait else None)
