"""Known ways for a compiler to go wrong, planted with monkeypatch.

Nothing here depends on how a stage is written, only on what it gives.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, replace

from colony.compile.guards import Always, And, Not, Or, Recently
from colony.compile.network import Inhibitor, Suppressor
from colony.execute.operators import Operator
from tests.verify.testing.bugs_in_arrays import (
    always_found,
    always_wrapped,
    arrays,
    higher_of_two,
    looked_up,
    never_outside,
    never_wrapped,
)
from tests.verify.testing.bugs_in_code import (
    answers_at_once,
    bad_commands_sent,
    code,
    defaults_fresh,
    frozen_where_not_winning,
    generated,
    last_limit_wins,
    limits,
    limits_without_condition,
    moved_while_missing,
    never_silent,
    only_winners_active,
    operator,
    other_initial_values,
    range_before_limits,
    rounded_up,
    sensors_changed,
    short_circuited,
    sustained_over_silence,
    unknown_bounds_zero,
    without_memory,
)
from tests.verify.testing.bugs_in_contracts import (
    both_branches,
    forgotten_commands,
    lowered,
    memory_of_placeholders,
    strict_logic,
    unknown_holds,
)
from tests.verify.testing.bugs_in_failsafe import (
    as_ordinary,
    decisions,
    error_is_not_applicable,
    first_answer_is_not_applicable,
    kept_by_those_above,
    limits_hold,
    machines,
    moved_while_blind,
    no_activity_when_blind,
    nobody_wins,
    not_active_when_blind,
    passed_over,
    placeholders_sent,
    without_blindness,
)
from tests.verify.testing.bugs_in_passes import (
    Plant,
    after,
    dominant_though_inhibited,
    gates_swapped,
    inhibiting_for_long,
    last_part_dropped,
    left_associated,
    links,
    lists,
    lowest_lost,
    nodes,
    not_exclusive,
    numbered_at_first_visit,
    observed_shifted,
    one_use_forgotten,
    reversed_priorities,
    rewired,
    suppressing,
    swapped,
    table,
    ungated,
    window,
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Bug:
    """A mistake; `plant` makes it.

    It shows in networks alone if `network`, else in whole programs; in generated Python if `generated`, else
    in the clients.
    """

    name: str
    plant: Plant
    network: bool = False
    generated: bool = False


BUGS: tuple[Bug, ...] = (
    # wiring
    Bug(
        name="children of suppressors swapped",
        network=True,
        plant=nodes(lambda n: swapped(n) if isinstance(n, Suppressor) else n),
    ),
    Bug(
        name="children of inhibitors swapped",
        network=True,
        plant=nodes(lambda n: swapped(n) if isinstance(n, Inhibitor) else n),
    ),
    Bug(name="inhibitors taken for suppressors", network=True, plant=nodes(suppressing)),
    Bug(name="chains associated to the left", network=True, plant=rewired(left_associated)),
    Bug(
        name="time constants of a chain in reverse",
        network=True,
        plant=rewired(lambda c: replace(c, windows_ns=c.windows_ns[::-1])),
    ),
    Bug(name="time constants of suppressors dropped", network=True, plant=window(lambda ns: 0, Suppressor)),
    Bug(name="time constants of inhibitors dropped", network=True, plant=window(lambda ns: 0, Inhibitor)),
    Bug(name="time constants that include their end", network=True, plant=window(lambda ns: ns + 1)),
    Bug(name="time constants that end too soon", network=True, plant=window(lambda ns: ns - 1)),
    Bug(name="time constants off by one frame", network=True, plant=window(lambda ns: ns + 50_000_000)),
    Bug(
        name="a suppressor with a time constant only inhibits", network=True, plant=nodes(inhibiting_for_long)
    ),
    # inhibition elimination
    Bug(name="gates dropped", network=True, plant=links(ungated)),
    Bug(name="gates on the wrong wire", network=True, plant=links(gates_swapped)),
    Bug(name="dominant though inhibited", network=True, plant=links(dominant_though_inhibited)),
    Bug(
        name="activity of another wire observed",
        network=True,
        plant=after("eliminate_inhibition", observed_shifted),
    ),
    # forward traversal
    Bug(name="a shared module numbered at its first visit", network=True, plant=numbered_at_first_visit),
    Bug(
        name="one use forgotten in through", network=True, plant=after("forward_traversal", one_use_forgotten)
    ),
    Bug(name="priorities in reverse", network=True, plant=lists(reversed_priorities)),
    Bug(name="the lowest client lost", network=True, plant=lists(lowest_lost)),
    Bug(name="exclusive guards that are not", network=True, plant=lists(not_exclusive)),
    # guards
    Bug(
        name="a guard's last condition dropped",
        network=True,
        plant=table(lambda g: last_part_dropped(g, And)),
    ),
    Bug(
        name="a guard's last alternative dropped",
        network=True,
        plant=table(lambda g: last_part_dropped(g, Or)),
    ),
    Bug(name="negations dropped", network=True, plant=table(lambda g: Always() if isinstance(g, Not) else g)),
    Bug(
        name="recently taken for now",
        network=True,
        plant=table(lambda g: And((g.operand, g.operand)) if isinstance(g, Recently) else g),
    ),
    # memory
    Bug(name="memory moved on while missing", plant=code(moved_while_missing)),
    Bug(name="sustained over silent frames", plant=code(sustained_over_silence)),
    Bug(name="short-circuited memory", plant=code(short_circuited)),
    Bug(name="memory frozen where nobody wins", plant=code(frozen_where_not_winning)),
    Bug(name="memory that starts true", plant=code(other_initial_values)),
    Bug(
        name="windows that include their end",
        network=True,
        plant=operator(Operator.TIME_LESS, lambda x, y: x <= y),
    ),
    # missing and defaults
    Bug(name="modules never silent", plant=code(never_silent)),
    Bug(name="defaults taken for fresh", plant=code(defaults_fresh)),
    Bug(name="sensors not clamped", plant=sensors_changed(lambda s: replace(s, low=None, high=None))),
    Bug(name="only winners count as active", plant=sensors_changed(only_winners_active)),
    Bug(
        name="generated Python forgets who was active",
        generated=True,
        plant=generated(lambda s: re.sub(r"(self\.kept_last_\w+_is_active) = .*", r"\1 = False", s)),
    ),
    Bug(name="units of sensors ignored", plant=sensors_changed(lambda s: replace(s, factor=1.0))),
    # contracts
    Bug(name="unknown contracts hold", plant=lowered("holds", unknown_holds)),
    Bug(name="unknown and false is unknown", plant=lowered("_connected", strict_logic)),
    Bug(name="both branches of if in contracts", plant=lowered("_choice", both_branches)),
    Bug(name="contracts remember placeholders", plant=lowered("_memory", memory_of_placeholders)),
    Bug(name="contracts forget what is held", plant=lowered("_held", forgotten_commands)),
    # failsafe modules and transitions
    Bug(name="blind modules not active", plant=code(not_active_when_blind)),
    Bug(name="memory of blind modules moved on", plant=code(moved_while_blind)),
    Bug(name="blind frames do not count for time constants", plant=code(no_activity_when_blind)),
    Bug(name="blind winners send placeholders", plant=code(placeholders_sent)),
    Bug(name="blind winners count as nobody", plant=decisions(nobody_wins)),
    Bug(name="limits hold for blind winners", plant=decisions(limits_hold)),
    Bug(name="transitions below a missing one taken", plant=machines(passed_over)),
    Bug(name="failsafe transitions not taken where missing", plant=machines(as_ordinary)),
    Bug(name="failsafe transitions kept by a missing one", plant=machines(kept_by_those_above)),
    Bug(name="errors of Python modules taken for None", plant=error_is_not_applicable),
    Bug(name="Python modules not applicable before they answer", plant=first_answer_is_not_applicable),
    # what is sent
    Bug(name="the last of several limits only", plant=limits(lambda of: of[-1:])),
    Bug(
        name="limits the wrong way round",
        plant=limits(lambda of: tuple(replace(m, relation="<=" if m.relation == ">=" else ">=") for m in of)),
    ),
    Bug(name="limits without their condition", plant=code(limits_without_condition)),
    Bug(name="the range before the limits", plant=range_before_limits),
    Bug(name="the last of contradicting limits", plant=last_limit_wins),
    Bug(name="unknown bounds at zero", plant=unknown_bounds_zero),
    Bug(name="commands that are not finite sent", plant=bad_commands_sent),
    Bug(name="Python modules answer at once", plant=answers_at_once),
    # elements of arrays
    Bug(name="all indices wrap", plant=arrays("position", always_wrapped)),
    Bug(name="indices of rings do not wrap", plant=arrays("position", never_wrapped)),
    Bug(name="value_or takes what is outside", plant=arrays("_element", always_found)),
    Bug(name="the higher of two equally near", plant=looked_up(higher_of_two)),
    Bug(name="nothing outside an arc", plant=looked_up(never_outside)),
    # generated Python
    Bug(name="generated Python forgets one memory", generated=True, plant=generated(without_memory)),
    Bug(
        name="generated Python compares loosely",
        generated=True,
        plant=generated(lambda s: s.replace(" < ", " <= ")),
    ),
    Bug(name="generated Python sends placeholders", generated=True, plant=generated(without_blindness)),
    # arithmetic
    Bug(name="NaN ignored by min", plant=operator(Operator.MIN, lambda *x: min(x))),
    Bug(name="NaN ignored by max", plant=operator(Operator.MAX, lambda *x: max(x))),
    Bug(name="sums begun with zero", plant=operator(Operator.SUM, lambda *x: 0.0 + sum(x))),
    Bug(
        name="remainders with the sign of x",
        plant=operator(Operator.MODULO, lambda x, y: math.fmod(x, y) if y and math.isfinite(x) else math.nan),
    ),
    Bug(name="halves rounded up", plant=operator(Operator.ROUND, rounded_up)),
    Bug(
        name="division by zero without its sign",
        plant=operator(
            Operator.DIVIDE, lambda x, y: x / y if y else math.nan if not x or x != x else math.inf
        ),
    ),
    Bug(name="negation by subtraction", plant=operator(Operator.NEGATE, lambda x: 0.0 - x)),
    Bug(
        name="angles in radians",
        plant=operator(Operator.SIN, lambda x: math.sin(x) if math.isfinite(x) else math.nan),
    ),
    Bug(
        name="atan2 with its arguments swapped",
        plant=operator(Operator.ATAN2, lambda y, x: math.degrees(math.atan2(x, y))),
    ),
    Bug(
        name="the last of equals",
        plant=operator(Operator.INDEX_OF_MIN, lambda *x: float(len(x) - 1 - x[::-1].index(min(x)))),
    ),
    Bug(name="less or equal for less", plant=operator(Operator.LESS, lambda x, y: x <= y)),
)
