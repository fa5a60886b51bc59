"""The wording of numbers, times and lists in sentences."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

# --- suggestions ---------------------------------------------------------------------------------------
#
# The known names that are closest to an unknown name.


class Remedy(str):
    """A hint that names the text to write, which editors offer as a quick fix.

    Attributes:
        found: The text to replace, in the span of the finding; "" to write in front of the span.
        written: The text to write in its place, or several to choose from.
    """

    __slots__ = ("found", "written")

    found: str
    written: tuple[str, ...]

    def __new__(cls, hint: str, found: str = "", *written: str) -> Remedy:
        """Return the hint `hint` with what it replaces."""
        remedy = super().__new__(cls, hint)
        remedy.found, remedy.written = found, written
        return remedy


_MAX_NAME_LENGTH = 64
"""Maximum number of characters of a name that are compared: external input may be of any length."""


def did_you_mean(
    name: str, known_names: Iterable[str], *, max_names: int = 1, cutoff: float = 0.6
) -> str | None:
    """Return a hint with the known names that are closest to `name`; None if none is close.

    Case is ignored. Names are close if their `difflib` ratio is `cutoff` or more.

    Example:
        >>> did_you_mean("rserver", ["PServer", "RServer"])
        'did you mean `RServer`?'
    """
    from difflib import get_close_matches  # slow to import, and needed only after an error

    folded: dict[str, list[str]] = {}
    for candidate in dict.fromkeys(known_names):
        folded.setdefault(candidate.casefold(), []).append(candidate)
    closest = get_close_matches(name[:_MAX_NAME_LENGTH].casefold(), folded, n=max_names, cutoff=cutoff)
    suggestions = [candidate for key in closest for candidate in folded[key]][:max_names]
    if not suggestions:
        return None
    hint = f"did you mean {' or '.join(f'`{candidate}`' for candidate in suggestions)}?"
    return Remedy(hint, name, *suggestions)


# --- wording -------------------------------------------------------------------------------------------


MAX_QUOTED = 60
"""Maximum number of characters of a user's text in a message."""


def counted(count: int, noun: str) -> str:
    """Return a number of things.

    Example:
        >>> counted(1, "frame"), counted(3, "frame")
        ('1 frame', '3 frames')
    """
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def listed(words: Sequence[str], conjunction: str = "and") -> str:
    """Return words as a sentence lists them.

    Example:
        >>> listed(["a", "b", "c"], "or")
        'a, b or c'
    """
    *first, last = words or [""]
    return f"{', '.join(first)} {conjunction} {last}" if first else last


def quoted(names: Sequence[str], conjunction: str = "and") -> str:
    """Return names as a sentence lists them, each in backticks."""
    return listed([f"`{name}`" for name in names], conjunction)


def printable(text: str) -> str:
    r"""Return an untrusted text with its unprintable characters escaped.

    Example:
        >>> printable("a\tb")
        'a\\tb'
    """
    if text.isprintable():
        return text
    return "".join(
        c if c.isprintable() else c.encode("unicode_escape", "backslashreplace").decode() for c in text
    )


def shortened(text: str) -> str:
    """Return a text of a user as a message quotes it: its beginning, if it is long.

    Example:
        >>> shortened("3 mm"), len(shortened("3" * 1000))
        ('3 mm', 63)
    """
    return text if len(text) <= MAX_QUOTED else f"{text[:MAX_QUOTED]}..."


def one_line(text: str) -> str:
    """Return a text on one line, with single spaces.

    Example:
        >>> one_line("a  and   b")
        'a and b'
    """
    return " ".join(text.split())


def degrees_text(angle: float) -> str:
    """Return an angle in degrees as messages show it.

    Example:
        >>> degrees_text(-7.5), degrees_text(90.0)
        ('-7.5 deg', '90 deg')
    """
    return f"{angle:.10g} deg"


TIME_RESOLUTION_NS = 100_000
"""Resolution of times that people read: far below a frame, and above the jitter of a clock."""


def rounded_ns(ns: int) -> int:
    """Return a time or duration rounded to `TIME_RESOLUTION_NS`."""
    return round(ns / TIME_RESOLUTION_NS) * TIME_RESOLUTION_NS


def seconds_of(t_ns: int) -> float:
    """Return a time in seconds, rounded to `TIME_RESOLUTION_NS`.

    Example:
        >>> seconds_of(9_849_999_999)
        9.85
    """
    return rounded_ns(t_ns) / 1e9


def time_text(t_ns: int) -> str:
    """Return a time as messages show it.

    Example:
        >>> time_text(9_849_999_999)
        '9.85 s'
    """
    return f"{seconds_of(t_ns):.10g} s"


def duration_text(ns: int) -> str:
    """Return nanoseconds as the language writes them.

    Example:
        >>> duration_text(1_500_000_000), duration_text(250_000_000)
        ('1.5 s', '250 ms')
    """
    unit, scale, digits = ("s", 1_000_000_000, 9) if ns >= 1_000_000_000 else ("ms", 1_000_000, 6)
    whole, rest = divmod(ns, scale)
    fraction = f".{rest:0{digits}d}".rstrip("0").rstrip(".")
    return f"{whole}{fraction} {unit}"
