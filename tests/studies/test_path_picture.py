"""Pictures of experiments."""

from __future__ import annotations

from matplotlib.collections import LineCollection

from studies.path_picture import DrivenPath, draw_errors, draw_paths, encode
from tests.buildings import HALLWAY

FLOOR = HALLWAY
WAY = ((1000, 1000), (2000, 1000), (3000, 1500))


def test_each_way_is_a_line_and_failed_ones_lie_on_top() -> None:
    drives = [
        DrivenPath(WAY, True, 1),
        DrivenPath(WAY[:2], False, 2),
        DrivenPath(WAY, True, 3),
        DrivenPath(WAY[:1], True, 4),
    ]
    figure = draw_paths(FLOOR, drives, "a title")
    lines = [c for c in figure.axes[0].collections if isinstance(c, LineCollection) and c.get_zorder() == 6]
    assert [len(line.get_segments()) for line in lines] == [2, 1]
    assert any(text.get_text() == "a title" for text in figure.axes[0].texts)
    assert encode(figure) == encode(draw_paths(FLOOR, drives, "a title"))
    assert encode(draw_paths(FLOOR, [], "none")).startswith(b"\x89PNG")


def test_errors_are_counted_in_bins_of_two_centimeters() -> None:
    axes = draw_errors([-15.0, 5.0, 8.0, 5000.0], "some").axes[0]
    counts = {round(p.get_x(), 3): p.get_height() for p in axes.patches if p.get_height()}  # type: ignore[attr-defined]
    assert counts == {-0.02: 1.0, 0.0: 2.0, 0.98: 1.0}
    assert "4 runs" in axes.get_title(loc="left")
    assert draw_errors([], "none").axes[0].get_title(loc="left") == "none: 0 runs that reached the goal"
