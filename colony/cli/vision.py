"""`colony vision`: the detections in a user's picture."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import click

from colony.cli.exit_codes import EXIT_MISUSE
from colony.cli.outputs import check_output, write_whole
from colony.cli.reporting import say
from colony.extras import expect_extras
from colony.files import read_file, reason

if TYPE_CHECKING:
    from colony.vision.detectors import Detection, DetectorRun

_DETECTORS = ("plates", "markers", "lights")


@click.command("vision", short_help="show what the detectors see in a picture")
@click.argument("files", metavar="FILE...", nargs=-1, required=True)
@click.option(
    "--detector",
    "chosen",
    type=click.Choice(_DETECTORS),
    multiple=True,
    help="The detector to run. May be repeated. "
    "[default: plates and markers, and lights if neither is found]",
)
@click.option(
    "-o",
    "--output",
    metavar="OUT.png",
    help="The annotated picture. [default: FILE.seen.png beside each file]",
)
@click.option("--format", "format_", type=click.Choice(["text", "json"]), default="text", show_default=True)
def command(files: tuple[str, ...], chosen: tuple[str, ...], output: str | None, format_: str) -> None:
    """Detect door plates, elevator markers and ceiling lights in pictures, and draw the detections.

    Pictures are PNG, JPEG, BMP, WebP or TIFF of any size, gray or in color. The detectors of plates and
    markers expect a level camera mounted as high as the signs hang, so that the signs are near the middle
    row; the detector of lights expects a camera that looks straight up at the ceiling. Both cameras have a
    horizontal field of view of 60 degrees. Coordinates are in pixels; (0, 0) is the upper left corner.

    A FILE.seen.png beside FILE is an older drawing, and is skipped.

    Exit code: 0, whether anything was found or not; 2 if a file cannot be read as an image.

    \b
    Example:
      colony vision side.png
      colony vision photo.jpg --detector plates -o found.png
      colony vision *.png --format json
    """
    expect_extras("vision")
    older_pictures = {_default_picture(file) for file in files} if output is None else set()
    files = tuple(file for file in files if Path(file) not in older_pictures)
    pictures = _pictures(files, output)
    reports = [_detect(file, picture, chosen, files) for file, picture in zip(files, pictures, strict=True)]
    if format_ == "json":
        import json

        click.echo(json.dumps({"files": [_summary(report) for report in reports]}, indent=2))
    else:
        for report in reports:
            if report.error is None:
                click.echo(_text(report))
    if any(report.error for report in reports):
        raise click.exceptions.Exit(EXIT_MISUSE)


class _Report(NamedTuple):
    """The result for a file: the detector runs, or the error that prevented them."""

    file: str
    size: tuple[int, int]
    runs: tuple[DetectorRun, ...]
    picture: Path
    error: str | None = None


def _pictures(files: Sequence[str], output: str | None) -> list[Path]:
    """Return the path of each file's drawing; refuse two files with the same path."""
    context = click.get_current_context()
    if output is not None:
        if Path(output).suffix.lower() != ".png":
            raise click.UsageError(f"cannot draw into `{output}`; expected a file ending in .png", context)
        if len(files) > 1:
            found = f"{len(files)} files and one -o {output}"
            raise click.UsageError(f"{found}; expected one file, or several without -o", context)
        return [Path(output)]
    pictures = [_default_picture(file) for file in files]
    for i, picture in enumerate(pictures):
        if picture in pictures[:i]:
            other = files[pictures.index(picture)]
            both = f"`{other}` and `{files[i]}` would both be drawn into `{picture}`"
            message = f"{both}; give one at a time, with -o"
            raise click.UsageError(message, context)
    return pictures


def _default_picture(file: str) -> Path:
    """Return the default path of a file's drawing."""
    return Path(file).parent / f"{Path(file).stem or 'image'}.seen.png"


def _detect(file: str, picture: Path, chosen: Sequence[str], files: Sequence[str]) -> _Report:
    """Read a file, run the detectors, and draw the detections; report a file that cannot be read."""
    from colony.vision.detectors import Detector, run_detectors
    from colony.vision.gray_images import gray_image
    from colony.vision.image_files import MAX_BYTES, ImageFormatError, annotate, decode_image, encode_png

    try:
        image = decode_image(read_file(file, MAX_BYTES))
    except (OSError, ImageFormatError) as problem:
        why = reason(problem)
        say(f"{file}: error: {why}")
        return _Report(file, (0, 0), (), picture, why)
    check_output(picture, files)
    runs = tuple(run_detectors(gray_image(image), frozenset(map(Detector, chosen))))
    found = [(run.detector, detection) for run in runs for detection in run.found]
    write_whole(picture, encode_png(annotate(image, found)))
    return _Report(file, (image.shape[1], image.shape[0]), runs, picture)


def _box(detection: Detection) -> tuple[float, float, float, float]:
    """Return the column and row of a detection's center, its width and its height, in pixels."""
    columns, rows = zip(*detection.corners, strict=True)
    width, height = max(columns) - min(columns), max(rows) - min(rows)
    return min(columns) + width / 2.0, min(rows) + height / 2.0, width, height


def _text(report: _Report) -> str:
    lines = [
        f"{report.file}: {report.size[0]} x {report.size[1]} pixels, drawn in {report.picture}",
        "detector  found       column     row   width  height  confidence       ms",
    ]
    for run in report.runs:
        rows = [_row(detection) for detection in run.found] or [f"{'nothing':<46}"]
        for i, row in enumerate(rows):
            time_text = f"{run.milliseconds:8.1f}" if i == 0 else ""
            lines.append(f"{run.detector.value if i == 0 else '':8}  {row:<58}{time_text}".rstrip())
    return "\n".join(lines)


def _row(detection: Detection) -> str:
    column, row, width, height = _box(detection)
    confidence = (
        detection.label_confidence
        if detection.label and detection.label_confidence is not None
        else detection.confidence
    )
    confidence_text = "" if confidence is None else f"{confidence:.2f}"
    return (
        f"{detection.label or '-':8}  {column:8.1f}{row:8.1f}{width:8.1f}{height:8.1f}{confidence_text:>12}"
    )


def _summary(report: _Report) -> dict[str, object]:
    if report.error is not None:
        return {"file": report.file, "error": report.error}
    return {
        "file": report.file,
        "columns": report.size[0],
        "rows": report.size[1],
        "picture": str(report.picture),
        "detectors": [
            {
                "detector": run.detector.value,
                "milliseconds": round(run.milliseconds, 3),
                "found": [_found(detection) for detection in run.found],
            }
            for run in report.runs
        ],
    }


def _found(detection: Detection) -> dict[str, object]:
    return {
        "label": detection.label,
        "corners": [[round(column, 2), round(row, 2)] for column, row in detection.corners],
        "confidence": None if detection.confidence is None else round(detection.confidence, 4),
        "label_confidence": None
        if detection.label_confidence is None
        else round(detection.label_confidence, 4),
    }
