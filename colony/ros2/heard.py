"""Messages of a topic that another controller commands, as the parameters of a command."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from colony.ir.ros2_messages import AUTO, DRIVE_PATHS, TWIST, TWIST_STAMPED
from colony.ir.types import ScalarValue
from colony.ros2.incoming import part
from colony.ros2.scan import UnusableError


class ParameterReader:
    """Reads the messages of a commanded topic; the parts that each parameter sets are those it is read from.

    Args:
        topic: the options of the command, with the names of its parameters in `names`.
    """

    def __init__(self, topic: Mapping[str, Any]) -> None:
        self._is_twist = topic["type"] in (AUTO, TWIST, TWIST_STAMPED)
        self._members: Mapping[str, float] | None = topic.get("members")
        names, paths = topic.get("names") or (), topic.get("parameters") or {}
        otherwise = DRIVE_PATHS if self._is_twist else {} if len(names) > 1 else dict.fromkeys(names, "data")
        self._paths = {name: paths.get(name) or otherwise.get(name, name) for name in names}

    def read(self, values: Mapping[str, Any]) -> dict[str, ScalarValue]:
        """Return the parameters that a message sets, in the units of ROS.

        Raises:
            UnusableError: it lacks the part of a parameter.
        """
        values = values["twist"] if self._is_twist and "twist" in values else values
        return {name: self._scalar(path, part(values, path)) for name, path in self._paths.items()}

    def _scalar(self, path: str, found: Any) -> ScalarValue:
        if isinstance(found, str):
            if self._members is None or found not in self._members:
                raise UnusableError(f'"{found[:40]}" is no member of the enum')
            return self._members[found]
        if not isinstance(found, bool | int | float) or found != found:
            raise UnusableError(f"`{path}` is {found!r:.40}; expected a number")
        return found if isinstance(found, bool) else float(found)
