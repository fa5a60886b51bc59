"""The detectors on pictures of a renderer that they were not made with, and that renderer itself.

The pictures of tests/vision/corpus are only measured: nothing was tuned on them.
"""

from __future__ import annotations

import ast
import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from colony.nav.maps.signs import PLATE_HEIGHT_MM, PLATE_WIDTH_MM
from colony.vision.detectors import Detection, Detector
from colony.vision.level_camera import AHEAD
from tools.second_renderer import measure
from tools.second_renderer.lettering import FONTS, font_file, plate
from tools.second_renderer.measure import CORPUS, PAGE, Picture, Score, overlap, pictures, score

RENDERER = Path(measure.__file__).parent
Scores = dict[Detector, Score]


@pytest.fixture(scope="module")
def looked_at() -> list[Picture]:
    return list(pictures())


@pytest.fixture(scope="module")
def scores(looked_at: list[Picture]) -> Scores:
    found = {detector: score(detector, looked_at) for detector in Detector}
    print("\n".join([*measure.table(found), *measure.failures(found)]))
    return found


def test_plates_are_found(scores: Scores) -> None:
    plates = scores[Detector.PLATES]
    assert plates.whole >= 30
    assert plates.found >= 0.9 * plates.whole, plates.missed
    assert plates.false <= 0.05 * plates.pictures, plates.invented


def test_plates_are_read(scores: Scores) -> None:
    plates = scores[Detector.PLATES]
    assert plates.right >= 0.9 * plates.found, plates.wrong


def test_markers_are_found_and_nothing_else_is_one(scores: Scores) -> None:
    markers = scores[Detector.MARKERS]
    assert markers.whole >= 8
    assert markers.found >= 0.9 * markers.whole, markers.missed
    assert markers.right == markers.found, markers.wrong
    assert markers.false <= 0.05 * markers.pictures, markers.invented


def test_lights_that_are_on_are_found(scores: Scores) -> None:
    lights = scores[Detector.LIGHTS]
    assert lights.whole >= 5
    assert lights.found >= 0.9 * lights.whole, lights.missed
    assert lights.false == 0, lights.invented


# --- the corpus --------------------------------------------------------------------------------------------


def test_the_corpus_is_what_it_says() -> None:
    images = json.loads((CORPUS / "truth.json").read_text(encoding="utf-8"))["images"]
    files = {image["file"] for image in images}
    assert files == {path.name for path in CORPUS.glob("*.png")}
    assert 60 <= len(files) <= 90
    assert sum(path.stat().st_size for path in CORPUS.iterdir()) < 2_500_000
    assert {image["font"] for image in images if image["font"]} == set(FONTS)


def test_the_page_tells_of_this_corpus(scores: Scores) -> None:
    """Of the figures only what the corpus says: what is found may differ with the release of a library."""
    page = PAGE.read_text(encoding="utf-8")
    for detector, counts in scores.items():
        assert f"| {detector} | {counts.pictures} | {counts.whole} | " in page


# --- the measure -------------------------------------------------------------------------------------------

SQUARE = [[10.0, 10.0], [30.0, 10.0], [30.0, 20.0], [10.0, 20.0]]
IMAGE = np.zeros((120, 240, 3), dtype=np.uint8)


def _spot(shift: float, label: str = "12") -> tuple[Detector, Detection]:
    first, second, third, fourth = ((column + shift, row) for column, row in SQUARE)
    return Detector.PLATES, Detection((first, second, third, fourth), label, 1.0, 1.0)


@pytest.mark.parametrize(
    ("seen", "whole", "expected"),
    [
        ((_spot(0.0),), True, (1, 1, 1, 0)),
        ((_spot(2.0, "72"),), True, (1, 1, 0, 0)),
        ((), True, (1, 0, 0, 0)),
        ((_spot(15.0),), True, (1, 0, 0, 1)),
        ((_spot(0.0), _spot(1.0)), True, (1, 1, 1, 1)),
        ((), False, (0, 0, 0, 0)),
        ((_spot(9.0),), False, (0, 0, 0, 0)),
        ((_spot(60.0),), False, (0, 0, 0, 1)),
    ],
)
def test_what_counts(
    seen: tuple[tuple[Detector, Detection], ...], whole: bool, expected: tuple[int, ...]
) -> None:
    target = {"kind": "plate", "text": "12", "corners": SQUARE, "whole": whole}
    counts = score(Detector.PLATES, [Picture("plates_00", IMAGE, (target,), seen)])
    assert (counts.whole, counts.found, counts.right, counts.false) == expected


@pytest.mark.parametrize(("on", "shift", "expected"), [
    (True, 0.0, (1, 1, 0)), (True, 5.0, (1, 1, 0)), (True, 20.0, (1, 0, 0)), (True, 150.0, (1, 0, 1)),
    (False, 0.0, (0, 0, 1)),
])  # fmt: skip
def test_what_counts_of_lights(on: bool, shift: float, expected: tuple[int, ...]) -> None:
    far, near = 120.0, 30.0
    corners = [[far, -5.0], [far, 125.0], [near, 125.0], [near, -5.0]]
    target = {"kind": "light", "on": on, "corners": corners, "whole": False}
    start, end = near + shift, far + shift
    detection = Detection(((start, -0.5), (end, -0.5), (end, 119.5), (start, 119.5)), "", 1.0, None)
    counts = score(
        Detector.LIGHTS, [Picture("ceiling_00", IMAGE, (target,), ((Detector.LIGHTS, detection),))]
    )
    assert (counts.whole, counts.found, counts.false) == expected


def test_the_overlap_of_outlines() -> None:
    square = np.array(SQUARE)
    assert overlap(square, square) == pytest.approx(1.0)
    assert overlap(square, square + np.array([10.0, 0.0])) == pytest.approx(1.0 / 3.0)
    assert overlap(square, square + np.array([50.0, 0.0])) == 0.0


# --- the renderer ------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def renderer(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Load the renderer, which keeps compiled kernels in the home of the user that loads it first."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("HOME", str(tmp_path_factory.mktemp("home")))
        pytest.importorskip("mitsuba", reason="the extra `renderer` is not installed")
        yield


def test_nothing_is_shared_with_the_simulator() -> None:
    for path in RENDERER.glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names = [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            names += [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            assert not any(name.startswith("colony.sim") for name in names), path


def test_no_reader_was_trained_with_its_fonts() -> None:
    from tools.training.fonts import learned_fonts

    own = {font_file(name).resolve().parent for name in FONTS}
    learned = [font.resolve() for font in learned_fonts()]
    assert learned
    assert not [path for path in learned if path.parent in own]


def test_plates_have_their_size_and_their_letters() -> None:
    for font in FONTS:
        sheet = plate("B8", font, black=0.04, white=0.8)
        assert (sheet.width_mm, sheet.height_mm) == (PLATE_WIDTH_MM, PLATE_HEIGHT_MM)
        rows = np.nonzero((sheet.picture[:, :, 0] > 0.5).any(axis=1))[0]
        assert (rows[-1] - rows[0] + 1) / 2.0 == pytest.approx(89.0, abs=3.0)
        columns = np.nonzero((sheet.picture[:, :, 0] > 0.5).any(axis=0))[0]  # of half a mm each
        assert (columns[0] + columns[-1]) / 2.0 == pytest.approx(PLATE_WIDTH_MM, abs=8.0)


@pytest.mark.usefixtures("renderer")
def test_a_scene_is_rendered_with_its_truth_where_it_is_seen() -> None:
    """A few paths of light a pixel are enough to see where a plate is."""
    from tools.second_renderer.render import render
    from tools.second_renderer.scenes import plate_scene

    scene = plate_scene(1001, plates=True, size=(240, 120))
    picture, targets = render(scene, seed=1001, samples=3)
    assert picture.shape == (120, 240)
    plates = [target for target in targets if target["kind"] == "plate" and target["whole"]]
    assert plates
    for target in plates:
        (left, top), (right, _), (_, bottom), _ = target["corners"]
        inside = picture[round(top) + 2 : round(bottom) - 1, round(left) + 2 : round(right) - 1]
        above = picture[round(top) - 5 : round(top) - 2, round(left) : round(right)]
        assert np.median(inside) < 0.75 * np.median(above)


@pytest.mark.usefixtures("renderer")
def test_the_corpus_is_of_these_scenes() -> None:
    from tools.second_renderer.__main__ import scenes
    from tools.second_renderer.render import truth

    counts = json.loads((CORPUS / "truth.json").read_text(encoding="utf-8"))
    images = {Path(image["file"]).stem: image for image in counts["images"]}
    made = {name: make for name, _, make in scenes(counts["seed"], counts["walls"])}
    assert list(made) == list(images)
    for name in ("plates_02", "walls_24", "markers_05", "ceiling_02"):
        assert truth(made[name]()) == images[name]["targets"]


@pytest.mark.usefixtures("renderer")
def test_its_camera_is_a_level_camera() -> None:
    from tools.second_renderer.render import _seen_at
    from tools.second_renderer.scenes import View

    view = View("level", (1.8, 0.0, 1.35), (-1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (240, 120), 0.0, 0.0, 1.8)
    camera = AHEAD
    seen = _seen_at(np.array([0.0, 0.5, 1.4]), view)
    assert seen[0] == pytest.approx(camera.column_of(-np.degrees(np.arctan2(0.5, 1.8))))
    assert seen[1] == pytest.approx(camera.row_of(1400.0, 1800.0))


@pytest.mark.parametrize(
    ("arguments", "counts"),
    [
        (["--seed", "-1"], "`-1` is no seed; expected a whole number from 0 on"),
        (["--seed", "1", "--count", "0"], "`0` is no number of walls"),
        (["--seed", "1", "--only", "plate_01"], "no picture begins with `plate_01`"),
    ],
)
@pytest.mark.usefixtures("renderer")
def test_sets_that_cannot_be_are_refused(
    arguments: list[str],
    counts: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    from tools.second_renderer import __main__ as command

    monkeypatch.setattr("sys.argv", ["renderer", *arguments, "-o", str(tmp_path / "set")])
    with pytest.raises(SystemExit, match="2"):
        command.main()
    assert counts in capsys.readouterr().err
    assert not (tmp_path / "set").exists()


def test_a_folder_that_is_no_set_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.argv", ["measure", str(tmp_path)])
    with pytest.raises(SystemExit, match="2"):
        measure.main()
    assert "has no truth.json; expected a set of pictures" in capsys.readouterr().err
