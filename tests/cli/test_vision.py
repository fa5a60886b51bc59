"""`colony vision`."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from tests.cli.conftest import Colony
from tests.paths import ROOT

CORPUS = ROOT / "tests" / "vision" / "corpus"
TRUTH = {
    image["file"]: image["targets"]
    for image in json.loads((CORPUS / "truth.json").read_text(encoding="utf-8"))["images"]
}


@pytest.fixture
def side(tmp_path: Path) -> Path:
    """A picture of a plate."""
    return Path(shutil.copy(CORPUS / "plates_01.png", tmp_path / "side.png"))


def test_a_plate_is_read_and_drawn(colony: Colony, side: Path, tmp_path: Path) -> None:
    code, out, err = colony("vision", "side.png")
    assert (code, err) == (0, "")
    lines = out.splitlines()
    assert lines[0] == "side.png: 240 x 120 pixels, drawn in side.seen.png"
    assert lines[1].split() == ["detector", "found", "column", "row", "width", "height", "confidence", "ms"]
    assert lines[2].split()[:2] == ["plates", TRUTH["plates_01.png"][0]["text"]]
    assert not any(line.startswith("lights") for line in lines)
    with Image.open(tmp_path / "side.seen.png") as drawn:
        assert drawn.size == (480, 240)


def test_a_summary_for_programs(colony: Colony, side: Path) -> None:
    out = colony.output("vision", "side.png", "--detector", "plates", "--format", "json", "-o", "o.png")
    (file,) = json.loads(out)["files"]
    assert (file["columns"], file["rows"], file["picture"]) == (240, 120, "o.png")
    (looked,) = file["detectors"]
    assert looked["detector"] == "plates"
    assert looked["milliseconds"] > 0.0
    (found,) = looked["found"]
    (target,) = TRUTH["plates_01.png"]
    assert found["label"] == target["text"]
    assert np.abs(np.array(found["corners"]) - np.array(target["corners"])).max() < 3.0
    assert 0.5 < found["label_confidence"] <= 1.0


def test_a_marker_and_a_light(colony: Colony) -> None:
    out = colony.output("vision", CORPUS / "markers_01.png", "-o", "m.png", "--detector", "markers")
    assert f"markers   {TRUTH['markers_01.png'][0]['code']:03b} " in out
    out = colony.output("vision", CORPUS / "ceiling_01.png", "-o", "c.png")
    assert [line.split()[:2] for line in out.splitlines()[2:]] == [
        ["plates", "nothing"], ["markers", "nothing"], ["lights", "-"],
    ]  # fmt: skip


def test_color_alpha_16_bits_and_other_kinds_of_files(colony: Colony, side: Path, tmp_path: Path) -> None:
    with Image.open(side) as image:
        gray = np.array(image)
    Image.fromarray(gray.astype(np.uint16) * 257).save(tmp_path / "deep.png")
    Image.fromarray(gray).convert("RGBA").save(tmp_path / "alpha.png")
    Image.fromarray(gray).convert("RGB").save(tmp_path / "photo.jpg", quality=95)
    Image.fromarray(gray).save(tmp_path / "scan.tiff")
    Image.fromarray(gray).save(tmp_path / "old.bmp")
    Image.fromarray(gray).convert("RGB").save(tmp_path / "new.webp", lossless=True)
    Image.fromarray(gray).resize((1200, 600), Image.Resampling.BICUBIC).save(tmp_path / "large.png")
    files = ["deep.png", "alpha.png", "photo.jpg", "scan.tiff", "old.bmp", "new.webp", "large.png"]
    code, out, err = colony("vision", *files, "--detector", "plates", "--format", "json")
    assert (code, err) == (0, "")
    texts = [file["detectors"][0]["found"][0]["label"] for file in json.loads(out)["files"]]
    assert texts == [TRUTH["plates_01.png"][0]["text"]] * len(files)


def test_nothing_in_a_black_image(colony: Colony, tmp_path: Path) -> None:
    Image.new("L", (240, 120)).save(tmp_path / "black.png")
    code, out, err = colony("vision", "black.png")
    assert (code, err) == (0, "")
    assert [line.split()[1] for line in out.splitlines()[2:]] == ["nothing"] * 3


def test_bad_files_are_told_and_the_others_looked_at(colony: Colony, side: Path, tmp_path: Path) -> None:
    (tmp_path / "empty.png").touch()
    (tmp_path / "text.png").write_text("robot r { }")
    (tmp_path / "cut.png").write_bytes(side.read_bytes()[:4000])
    (tmp_path / "folder").mkdir()
    Image.new("L", (1, 1)).save(tmp_path / "dot.png")
    files = [
        "empty.png",
        "text.png",
        "cut.png",
        "folder",
        "dot.png",
        "missing.png",
        "no/where.png",
        "side.png",
    ]
    code, out, err = colony("vision", *files)
    assert code == 2
    assert out.startswith("side.png: 240 x 120 pixels")
    said = err.splitlines()
    assert [line.split(":")[0] for line in said] == files[:-1]
    assert said[0] == "empty.png: error: the file is empty; expected an image"
    assert said[1] == "text.png: error: not a readable image; expected PNG, JPEG, BMP, WEBP or TIFF"
    assert said[2].startswith("cut.png: error: the image is damaged: ")
    assert said[3] == "folder: error: Is a directory"
    assert said[4] == "dot.png: error: an image of 1 x 1 pixels; expected at least 4 x 4"
    assert said[5] == "missing.png: error: No such file or directory"
    assert sorted(p.name for p in tmp_path.glob("*.seen.png")) == ["side.seen.png"]


def test_bad_files_for_programs(colony: Colony, side: Path) -> None:
    code, out, _ = colony("vision", "missing.png", "side.png", "--format", "json")
    bad, good = json.loads(out)["files"]
    assert code == 2
    assert bad == {"file": "missing.png", "error": "No such file or directory"}
    assert good["picture"] == "side.seen.png"


def test_no_input_is_overwritten(colony: Colony, side: Path, tmp_path: Path) -> None:
    before = side.read_bytes()
    err = colony.refusal("vision", "side.png", "-o", "side.png")
    assert "side.png: error: cannot write: it is an input of this command" in err
    colony.refusal("vision", "side.png", "-o", str(tmp_path / "side.png"))
    assert side.read_bytes() == before


def test_what_was_drawn_before_is_no_input(colony: Colony, side: Path, tmp_path: Path) -> None:
    """As `*.png` gives it when it is typed again."""
    first = colony("vision", "side.png")
    drawn = (tmp_path / "side.seen.png").read_bytes()
    again = colony("vision", "side.png", "side.seen.png")
    assert (again.code, again.err) == (0, "")
    assert again.out.splitlines()[0] == first.out.splitlines()[0]
    assert "seen.seen" not in again.out
    assert (tmp_path / "side.seen.png").read_bytes() == drawn
    alone = colony("vision", "side.seen.png")  # it may be looked at where it is all that is asked for
    assert "side.seen.png: 480 x 240 pixels, drawn in side.seen.seen.png" in alone.out


def test_folders_are_no_pictures(colony: Colony) -> None:
    for file, why in ((".", "Is a directory"), ("", "No such file or directory")):
        assert why in colony.refusal("vision", file)


def test_outputs_that_cannot_be(colony: Colony, side: Path, tmp_path: Path) -> None:
    shutil.copy(side, tmp_path / "side.jpg")
    for arguments, why in (
        (["side.png", "side.jpg"], "would both be drawn into `side.seen.png`"),
        (["side.png", "side.jpg", "-o", "x.png"], "2 files and one -o x.png; expected one file"),
        (["side.png", "-o", "x.gif"], "expected a file ending in .png"),
        (["side.png", "-o", "no/x.png"], "cannot write: the folder does not exist"),
        ([], "Missing argument"),
        (["side.png", "--detector", "doors"], "'doors' is not one of"),
    ):
        assert why in colony.refusal("vision", *arguments)
    assert not list(tmp_path.glob("*.seen.png"))
