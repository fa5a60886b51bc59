"""The forty runs of the thesis, as published in its Tables 6.1 (old wing) and 6.2 (new wing)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, cast

Wing = Literal["old", "new"]
ModeLetter = Literal["l", "c", "d"]


@dataclass(frozen=True, slots=True, kw_only=True)
class PublishedRun:
    """A run and its outcome.

    Attributes:
        wing, number: the table, and its row.
        origin, goal: nodes of `maps/msu_engineering_3.stickrep`.
        began: date and time of day, ISO 8601.
        distance_mm: distance from jamb to jamb along the ring, rounded down to millimeters in the tables.
        beyond_goal_mm: distance of the stopped robot beyond the goal, negative before it; None for failed
            runs.
        seconds: duration; None for failed runs.
        completed, required: completed and required numbers of the modes l, c and d. The tables count a failed
            mode in some rows and not in others.
        failed_mode: the mode in which a failed run failed.
    """

    wing: Wing
    number: int
    origin: str
    goal: str
    began: str
    distance_mm: float
    beyond_goal_mm: float | None
    seconds: int | None
    completed: tuple[int, int, int]
    required: tuple[int, int, int]
    failed_mode: ModeLetter | None

    @property
    def reached(self) -> bool:
        """True if the robot reached its goal."""
        return self.beyond_goal_mm is not None

    @property
    def compensated(self) -> bool:
        """True if the overshoot was subtracted from the distances, as after December 22, 1993."""
        return self.began > "1993-12-23"


# Some numbers are illegible in print and were inferred from others. New wing, row 8: the corners, from the
# ring and the total of 79 in section 6.3. Row 6: the lights, from the total of 57 there. Rows 1 and 2: the
# distances beyond the goal are guesses (2 cm may be right instead of 7).
_TABLE = """
wing no origin    goal         date       time     m      cm     s    L    C      D  failed in
old  1 350R         376L         1993-10-31 12:33   78.181   -13   326  1/1   0/0    1/1  -
old  2 350R         376L         1993-10-31 12:43   78.181    46   357  1/1   0/0    1/1  -
old  3 350R         376L         1993-10-31 13:07   78.181   -15   379  1/1   0/0    1/1  -
old  4 350R         376L         1993-10-31 13:25   78.181    20   369  1/1   0/0    1/1  -
old  5 350R         376L         1993-10-31 20:00   78.181    43   343  1/1   0/0    1/1  -
old  6 350R         376L         1993-10-31 20:17   78.181    61   314  1/1   0/0    1/1  -
old  7 350R         376L         1993-10-31 20:32   78.181    53   345  1/1   0/0    1/1  -
old  8 381L         343R         1993-10-31 12:59   73.863    81   302  1/1   0/0    1/1  -
old  9 381L         343R         1993-10-31 13:17   73.863    30   301  1/1   0/0    1/1  -
old 10 381L         343R         1993-10-31 13:33   73.863    66   311  1/1   0/0    1/1  -
old 11 381L         343R         1993-10-31 20:07   73.863    41   334  1/1   0/0    1/1  -
old 12 381L         343R         1993-10-31 20:24   73.863    25   299  1/1   0/0    1/1  -
old 13 381L         343R         1993-10-31 20:43   73.863     -     -  0/1   0/0    0/1  L
old 14 346L         388R         1993-11-10 10:32  107.950   -45   406  1/1   0/0    1/1  -
old 15 341L         311R         1993-11-15 15:50   91.795    60   580  3/3   2/2    1/1  -
old 16 303.second.R 350R         1993-11-15 16:03  106.984   100   520  3/3   2/2    1/1  -
old 17 345R         311.double.R 1993-11-22 12:16  105.714    36   756  3/3   2/2    1/1  -
old 18 341L         311L         1993-11-22 13:50   89.966    50   771  3/3   2/2    1/1  -
old 19 303.second.L 350R         1993-11-22 14:05  107.899  62.5   713  3/3   2/2    1/1  -
old 20 345R         311R         1993-12-05 22:05   96.774    48   811  3/3   2/2    1/1  -
old 21 303.second.L 350L         1993-12-05 22:40  106.070    75   640  3/3   2/2    1/1  -
old 22 345R         311.double.L 1993-12-13 11:21  103.886     -     -  1/3   1/2    0/1  C
old 23 NE.men.R     302R         1993-12-13 11:28  120.650    50   703  3/3   6/6    1/1  -
old 24 301R         350R         1993-12-13 11:41  154.686    60   952  3/4   6/6    1/1  -
old 25 350R         372L         1993-12-21 16:25   59.740    80   206  1/1   0/0    1/1  -
old 26 381R         NE.men.R     1993-12-21 16:31   92.354    50   310  1/1   0/0    1/1  -
old 27 acs.elev.R   376R         1994-01-05 20:42   89.052    20   371  1/1   0/0    1/1  -
new  1 302L         A340R        1993-11-12 16:16   35.585    -7   453  1/1   1/1    1/1  -
new  2 A392L        A340R        1993-11-12 17:02   15.113     7   189  1/1   1/1    1/1  -
new  3 311L         381R         1993-11-13 19:57  171.754   -36  1436  6/6   8/8    1/1  -
new  4 323L         381R         1993-12-06 10:59  197.358     -     -  4/7   5/9    0/1  L
new  5 341R         381R         1993-12-06 16:30  260.807    75  1951  8/8   10/10  1/1  -
new  6 345R         345L         1993-12-06 17:07  337.007     -     -  7/9   8/10   0/1  C
new  7 A313L        345L         1993-12-08 10:59   98.958    95   579  2/2   2/2    1/1  -
new  8 NE.women.L   A314R        1993-12-09 00:08  203.911    59  1328  6/6   7/7    1/1  -
new  9 A314R        345R         1993-12-09 00:32  101.904    24   592  2/2   2/2    1/1  -
new 10 NW.men.L     A314R        1993-12-28 13:52  142.748    35  1136  5/5   6/6    1/1  -
new 11 A342L        A323R        1993-12-28 14:14   38.633    40   336  1/1   0/0    1/1  -
new 12 A347L        A385R        1994-01-05 21:16  103.530     -     -  2/3   1/2    0/1  C
new 13 A365L        301R         1994-01-05 21:28   69.900    48   581  2/2   1/1    1/1  -
"""


def _run(row: str) -> PublishedRun:
    wing, number, origin, goal, date, time, meters, beyond, seconds, *modes, failed = row.split()
    pairs = [tuple(map(int, mode.split("/"))) for mode in modes]
    lights, corners, dead_reckoning = pairs
    return PublishedRun(
        wing=cast(Wing, wing),
        number=int(number),
        origin=origin,
        goal=goal,
        began=f"{date}T{time}",
        distance_mm=round(float(meters) * 1000.0, 3),
        beyond_goal_mm=None if beyond == "-" else float(beyond) * 10.0,
        seconds=None if seconds == "-" else int(seconds),
        completed=(lights[0], corners[0], dead_reckoning[0]),
        required=(lights[1], corners[1], dead_reckoning[1]),
        failed_mode=None if failed == "-" else cast(ModeLetter, failed.lower()),
    )


PUBLISHED_RUNS: tuple[PublishedRun, ...] = tuple(_run(row) for row in _TABLE.strip().splitlines()[1:])
"""All published runs, in the order of the tables."""
