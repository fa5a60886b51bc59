"""The conversion of a twist_mux configuration into a behavior, an interface and a body of a robot on ROS 2.

Each source becomes a module, a message of which is fresh within its timeout; each lock a module that inhibits
the sources up to its priority. As in twist_mux, a lock that has timed out is on. Unlike it, the robot gets
zeros on a lock, on a timeout and in silence, which contracts say.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

from colony.cli.ros2_texts import TAKEN, base_lines, chassis_lines, drive_lines
from colony.text.diagnostics import Diagnostic, DiagnosticError, error, in_order, note
from colony.text.source import Source, Span

NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,40}")
TOPIC = re.compile(r"[~/A-Za-z_][A-Za-z0-9_/{}~]{0,250}")
MAX_ENTRIES = 100

FASTEST_M_S, FASTEST_RAD_S = 1.0, 2.0
"""The highest speeds of a base, which no mux knows."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MuxInput:
    """A source of twists, or a lock.

    Attributes:
        name: its name, also that of its module.
        topic: its topic.
        timeout_s: age in s from which its newest message does not count; 0 for never.
        priority: its priority, from 0 to 255.
        span: its name in the file.
    """

    name: str
    topic: str
    timeout_s: float
    priority: int
    span: Span

    @property
    def within(self) -> str:
        """The maximum age of its messages, as a sensor declares it."""
        return f" within {self.timeout_s:g} s" if self.timeout_s else ""


@dataclass(frozen=True, slots=True, kw_only=True)
class TwistMux:
    """A configuration: sources and locks by descending priority, and whether messages are stamped."""

    sources: tuple[MuxInput, ...]
    locks: tuple[MuxInput, ...]
    stamped: bool
    notes: tuple[Diagnostic, ...] = ()


# --- reading -------------------------------------------------------------------------------------


def read_twist_mux(source: Source) -> TwistMux:
    """Read the YAML of twist_mux, with or without a node name and `ros__parameters` around it.

    Raises:
        DiagnosticError: X001 if it is none, X002 for what cannot be converted.
    """
    import yaml

    try:
        root = yaml.compose(source.text, Loader=yaml.SafeLoader)
    except yaml.YAMLError as problem:
        at = getattr(getattr(problem, "problem_mark", None), "index", 0)
        text = getattr(problem, "problem", None) or "it is not YAML"
        raise DiagnosticError([error("X001", Span(source, at, at + 1), f"not YAML: {text}")]) from None
    except RecursionError:
        raise DiagnosticError([error("X001", Span(source, 0, 1), "nested too deeply")]) from None
    reader = _Reader(source)
    settings = reader.settings(root)
    sources = reader.inputs(settings.get("topics"), "source")
    locks = reader.inputs(settings.get("locks"), "lock")
    if not sources and not reader.problems:
        hint = "expected `topics` with a name, `topic`, `timeout` and `priority` each"
        reader.problems.append(error("X001", Span(source, 0, 1), "no sources", hint))
    reader.check_names(sources, locks)
    reader.check_priorities(sources)
    if reader.problems:
        raise DiagnosticError(in_order(reader.problems))
    least = min(each.priority for each in sources)
    for idle in [each for each in locks if each.priority < least]:
        reader.notes.append(
            note("X002", idle.span, f"the lock `{idle.name}` masks no source, and is left out")
        )
        locks.remove(idle)
    stamped = settings.get("use_stamped")
    return TwistMux(
        sources=tuple(sorted(sources, key=lambda each: -each.priority)),
        locks=tuple(sorted(locks, key=lambda each: -each.priority)),
        stamped=stamped is not None and str(stamped.value).lower() == "true",
        notes=tuple(in_order(reader.notes)),
    )


class _Reader:
    """Reads nodes of YAML. Mutable: collects what is wrong."""

    def __init__(self, source: Source) -> None:
        self._source = source
        self.problems: list[Diagnostic] = []
        self.notes: list[Diagnostic] = []

    def span(self, node: Any) -> Span:
        return Span(self._source, node.start_mark.index, node.end_mark.index)

    def mapping(self, node: Any) -> dict[str, Any]:
        """Return the values of a mapping by key; none for any other node."""
        if getattr(node, "id", "") != "mapping":
            return {}
        return {str(key.value): value for key, value in node.value if key.id == "scalar"}

    def settings(self, root: Any) -> dict[str, Any]:
        """Return the mapping that has `topics`, wherever it is in the first levels."""
        level = [root]
        for _ in range(4):
            mappings = [self.mapping(node) for node in level[:MAX_ENTRIES]]
            for found in mappings:
                if "topics" in found:
                    return found
            level = [value for found in mappings for value in found.values()]
        return {}

    def inputs(self, node: Any, kind: str) -> list[MuxInput]:
        """Return the sources or locks of a mapping from names to theirs."""
        if node is None:
            return []
        if node.id != "mapping":
            self.problems.append(error("X001", self.span(node), f"expected a mapping from names to {kind}s"))
            return []
        found = (self._input(key, value, kind) for key, value in node.value[:MAX_ENTRIES])
        return [each for each in found if each is not None]

    def _input(self, key: Any, node: Any, kind: str) -> MuxInput | None:
        name, span, values = str(key.value), self.span(key), self.mapping(node)
        missing = [
            k for k in ("topic", "timeout", "priority") if getattr(values.get(k), "id", "") != "scalar"
        ]
        if missing:
            self.problems.append(error("X002", span, f"the {kind} `{name}` has no `{missing[0]}`"))
            return None
        timeout, priority = values["timeout"], values["priority"]
        timeout_s = self._number(timeout, "timeout", 0.0, 3600.0)
        level = self._number(priority, "priority", 0.0, 255.0)
        if timeout_s is None or level is None:
            return None
        if level == 0.0 and kind == "source":
            message = f"`{name}` never drives: twist_mux ignores priority 0"
            self.problems.append(error("X002", self.span(priority), message, "leave it out"))
        if timeout_s == 0.0:
            self.notes.append(self._endless(name, kind, self.span(timeout)))
        return MuxInput(
            name=f"{name}_input" if name in TAKEN else name,
            topic=self._topic(values["topic"]),
            timeout_s=timeout_s,
            priority=int(level),
            span=span,
        )

    def _topic(self, node: Any) -> str:
        topic = str(node.value)
        if TOPIC.fullmatch(topic) is None:
            message = f"`{topic[:60]}` is not the name of a topic"
            self.problems.append(error("X002", self.span(node), message))
        return topic

    def _endless(self, name: str, kind: str, span: Span) -> Diagnostic:
        if kind == "lock":
            return note(
                "X002",
                span,
                f"the lock `{name}` stays as it was when its publisher dies",
                "give it a timeout",
            )
        message = f"the last message of `{name}` drives for ever when its publisher dies"
        return note("X002", span, message, "give it a timeout, such as 0.5")

    def _number(self, node: Any, key: str, low: float, high: float) -> float | None:
        try:
            value = float(node.value)
        except ValueError:
            value = -1.0
        if low <= value <= high:
            return value
        message = f"`{key}`: expected a number from {low:g} to {high:g}; found `{str(node.value)[:40]}`"
        self.problems.append(error("X002", self.span(node), message))
        return None

    def check_names(self, sources: list[MuxInput], locks: list[MuxInput]) -> None:
        seen: set[str] = set()
        for each in (*sources, *locks):
            suffixes = ("", "_locked", "_is_on") if each in locks else ("", "_velocity", "_turn", "_sends")
            names = {each.name + suffix for suffix in suffixes}
            if NAME.fullmatch(each.name) is None:
                message = f"`{each.name[:60]}` cannot be a name in a behavior"
                hint = "use letters, digits and `_`, a letter first"
                self.problems.append(error("X002", each.span, message, hint))
            elif names & seen:
                message = f"`{each.name}`: a behavior would have `{min(names & seen)}` twice"
                self.problems.append(error("X002", each.span, message, "rename it"))
            seen |= names

    def check_priorities(self, sources: list[MuxInput]) -> None:
        by_priority: dict[int, MuxInput] = {}
        for each in sources:
            first = by_priority.setdefault(each.priority, each)
            if first is not each:
                message = f"`{each.name}` has the priority of `{first.name}`: their order decides who drives"
                self.problems.append(
                    error("X002", each.span, message, "give each source a priority of its own")
                )


# --- writing -------------------------------------------------------------------------------------


def behavior_text(mux: TwistMux, name: str) -> str:
    """Return the behavior."""
    parts = [
        f"# {name} - what twist_mux did: the source with the highest priority drives, unless a lock is on.",
        "# Unlike twist_mux, it stands on a lock, on a timeout and in silence: see the contracts.",
        "",
        "language 1",
        "import robot",
        "",
    ]
    parts += [
        f"let {each.name}_sends = fresh({each.name}_velocity) and fresh({each.name}_turn)"
        for each in mux.sources
    ]
    for each in mux.locks:
        otherwise = "true" if each.timeout_s else "false"
        parts.append(f"let {each.name}_is_on = value_or({each.name}_locked, {otherwise})")
    parts.append("")
    for each in mux.sources:
        parts += [
            f"# priority {each.priority}",
            f"module {each.name} {{",
            "  when true",
            f"  do   drive(velocity = clamp({each.name}_velocity, -fastest, fastest),",
            f"             turn = clamp({each.name}_turn, -fastest_turn, fastest_turn))",
            "}",
        ]
    for each in mux.locks:
        parts += [f"# priority {each.priority}: a lock", f"module {each.name} {{ when {each.name}_is_on }}"]
    parts += ["", "network {", f"  drive = {_wiring(mux)}", "}", ""]
    stands = "drive.velocity == 0 m/s and drive.turn == 0 rad/s"
    silent = " and ".join(f"not {each.name}_sends" for each in mux.sources)
    parts.append(f"contract stands_in_silence:\n  {silent}\n  implies {stands}")
    for lock in mux.locks:
        above = [f"not {each.name}_sends" for each in mux.sources if each.priority > lock.priority]
        condition = " and ".join((f"{lock.name}_is_on", *above))
        parts.append(f"contract stands_under_{lock.name}:\n  {condition}\n  implies {stands}")
    for lower in mux.sources[1:]:
        higher = [each for each in mux.sources if each.priority > lower.priority]
        sends = " or ".join(f"{each.name}_sends" for each in higher)
        parts.append(f"contract {lower.name}_waits:\n  {sends} implies not (drive by {lower.name})")
    return "\n".join(parts) + "\n"


def _wiring(mux: TwistMux) -> str:
    """Return the wiring: sources by priority, each lock before the first source that it masks."""
    rest = ""
    locks = list(mux.locks)
    for each in reversed(mux.sources):
        rest = f"{each.name} suppresses {_in_parentheses(rest)}" if rest else each.name
        above = next((s.priority for s in reversed(mux.sources) if s.priority > each.priority), 256)
        for lock in [lock for lock in locks if each.priority <= lock.priority < above]:
            rest = f"{lock.name} inhibits {_in_parentheses(rest)}"
            locks.remove(lock)
    return rest


def _in_parentheses(wiring: str) -> str:
    return f"({wiring})" if " " in wiring else wiring


def interface_text(mux: TwistMux, name: str) -> str:
    """Return the interface of the robot."""
    lines = [
        f"# {name} - the robot behind twist_mux.",
        "",
        "language 1",
        "",
        f"robot {name} {{",
        "  frame 50 ms",
    ]
    for each in mux.sources:
        for part, unit in (("velocity", "m/s"), ("turn", "rad/s")):
            lines.append(f"  sensor {each.name}_{part} : {unit} from Mux.{each.name}_{part}{each.within}")
    lines += [
        f"  sensor {each.name}_locked : bool from Mux.{each.name}_locked{each.within}" for each in mux.locks
    ]
    lines += [
        "  # Guessed: the highest speeds of the base, here and below.",
        *drive_lines(FASTEST_M_S, FASTEST_RAD_S),
        "}",
        "",
        f"param fastest = {FASTEST_M_S:g} m/s",
        f"param fastest_turn = {FASTEST_RAD_S:g} rad/s",
    ]
    return "\n".join(lines) + "\n"


def body_text(mux: TwistMux, name: str) -> str:
    """Return the body of the robot: its topics."""
    message = "geometry_msgs/msg/TwistStamped" if mux.stamped else "geometry_msgs/msg/Twist"
    prefix = "twist." if mux.stamped else ""
    lines = [
        f"# {name}.toml - the body of {name}: its topics. Shape, drive and limits are guessed.",
        "",
        "[robot]",
        f'name = "{name}"',
        "",
        "[body]",
        *chassis_lines(radius_mm=250, wheel_base_mm=400, velocity_m_s=FASTEST_M_S, turn_rad_s=FASTEST_RAD_S),
        "",
        "# The ROS environment: a script to source (`setup`), or a Python with rclpy (`python`).",
        "[ros2]",
        "",
        "# The output of twist_mux, whose place this takes: `alone` refuses to drive beside it.",
        "[server.RServer]",
        *base_lines(),
        "",
        "[server.Mux]",
    ]
    for each in mux.sources:
        for part, path in (("velocity", "linear.x"), ("turn", "angular.z")):
            topic = f'topic = "{each.topic}", type = "{message}", path = "{prefix}{path}"'
            lines.append(f"ros2.{each.name}_{part} = {{ {topic} }}")
    lines += [
        f'ros2.{each.name}_locked = {{ topic = "{each.topic}", type = "std_msgs/msg/Bool" }}'
        for each in mux.locks
    ]
    return "\n".join(lines) + "\n"
