"""What the control connections of a plant give for fields of the devices. No I/O."""

from __future__ import annotations

from colony.sim.given import Given, GivenTimeline, GivenValue

MAX_GIVEN = 100_000
"""Maximum number of changes that all connections may have given."""


class GivenFields:
    """What is given for fields of the devices of all robots, until its giver withdraws it. Mutable.

    Where several givers give the same field, the one that gave first most recently counts.
    """

    def __init__(self) -> None:
        self._timelines: dict[tuple[object, int], GivenTimeline] = {}

    def give(self, giver: object, robot: int, server: str, field: str, t_ns: int, value: GivenValue) -> None:
        """Give a field of a robot's device a value from a time on.

        Raises:
            ValueError: `MAX_GIVEN` changes have been given.
        """
        if sum(timeline.size for timeline in self._timelines.values()) >= MAX_GIVEN:
            raise ValueError(f"found more than {MAX_GIVEN} changes of fields; expected at most so many")
        self._timelines.setdefault((giver, robot), GivenTimeline()).add(server, field, t_ns, value)

    def withdraw(self, giver: object) -> None:
        """Withdraw all that a giver gave."""
        self._timelines = {key: found for key, found in self._timelines.items() if key[0] is not giver}

    def of(self, robot: int) -> Given:
        """Return the function that returns what is given for the devices of a robot."""

        def value_at(server: str, field: str, now_ns: int) -> GivenValue:
            for (_, number), timeline in reversed(self._timelines.items()):
                value = timeline.value_at(server, field, now_ns) if number == robot else None
                if value is not None:
                    return value
            return None

        return value_at
