"""The pictures of cameras: reduced, with what is found, and asked for only while a page is open."""

from __future__ import annotations

import threading
from base64 import b64decode
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from PIL import Image as PillowImage

from colony.nav.pose.pose import PoseEstimate, pose_list
from colony.nav.shared import POSE
from colony.runtime.kit.connection import Session
from colony.runtime.library import data
from colony.runtime.protocol.images import Image
from colony.runtime.protocol.messages import Node
from colony.runtime.servers.cserver import CServer
from colony.runtime.servers.dserver import DServer
from colony.watch import asking
from colony.watch.asking import (
    Ask,
    Asker,
    RobotView,
    asking_robot,
    find_nothing,
    find_signs,
    picture_of,
    reduced,
    whole_image,
)
from colony.watch.store import SnapshotStore
from colony.watch.watched import Watched
from tests.paths import ROOT
from tests.runtime.transport.live.stage import ROBOT, hosted, run_directory
from tests.waiting import until
from tests.watch.runs import page, scene, served, snapshots

PLATE = ROOT / "docs" / "cameras" / "376" / "side.png"


def image_of(path: Path, factor: int = 1) -> Image:
    """Return a picture of the documentation, each pixel repeated."""
    with PillowImage.open(path) as opened:
        pixels = np.asarray(opened.convert("L")).repeat(factor, 0).repeat(factor, 1)
    height, width = pixels.shape
    return Image(t_ns=1_500_000_000, height=height, width=width, channels=1, pixels=pixels.tobytes())


class Still:
    """A camera that always sees the same. Mutable: how often it was read."""

    def __init__(self, image: Image) -> None:
        self.image = image
        self.reads = 0

    height = property(lambda self: self.image.height)
    width = property(lambda self: self.image.width)
    channels = property(lambda self: self.image.channels)

    def grab(self) -> Still:
        return self

    def rows(self, first: int, count: int) -> Image:
        self.reads += 1
        return self.image.rows(first, count)


@contextmanager
def robot(*servers: Node) -> Iterator[Session]:
    """Run servers, and open a session with their robot."""
    with (
        run_directory() as environment,
        hosted(environment, servers),
        Session.open(ROBOT, environment=environment) as session,
    ):
        yield session


@pytest.mark.parametrize(("channels", "shown"), [(1, 1), (2, 1), (3, 3), (4, 1)])
@pytest.mark.parametrize("factor", [1, 2, 3])
def test_an_image_is_reduced_as_numpy_does(channels: int, shown: int, factor: int) -> None:
    pixels = np.random.default_rng(1).integers(0, 256, (5, 7, channels), np.uint8)
    image = Image(t_ns=1, height=5, width=7, channels=channels, pixels=pixels.tobytes())
    small = reduced(image, factor)
    expected = pixels[::factor, ::factor, :shown]
    assert (small.height, small.width, small.channels) == expected.shape
    assert small.pixels == expected.tobytes()


@pytest.mark.parametrize("factor", [1, 3])
def test_a_plate_is_found_and_framed_in_the_reduced_picture(factor: int) -> None:
    picture = picture_of("CServerSide", image_of(PLATE, factor), find_signs)
    assert picture.width <= 320
    assert picture.height <= 240
    assert picture.t == 1.5
    [plate] = picture.found
    assert (plate.kind, plate.label) == ("plate", "376")
    scale = picture.width / 240
    (left, top), _, (right, bottom), _ = plate.corners
    assert left == pytest.approx(99 * scale, abs=3)
    assert right == pytest.approx(140 * scale, abs=3)
    assert 48 * scale < top < bottom < 72 * scale


def test_images_that_detectors_cannot_read_have_no_findings() -> None:
    assert find_signs(Image(t_ns=1, height=2, width=2, channels=1, pixels=bytes(4))) == ()
    assert find_signs(Image(t_ns=1, height=8, width=8, channels=2, pixels=bytes(128))) == ()


def test_a_camera_is_read_in_bands_within_bounds(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(asking, "BAND_BYTES", 240 * 50)
    image = image_of(PLATE)
    with robot(CServer(Still(image))) as session, session.connect("CServer") as camera:
        assert whole_image(camera) == image
        monkeypatch.setattr(asking, "MAX_IMAGE_BYTES", len(image.pixels) - 1)
        assert whole_image(camera) is None


@pytest.mark.parametrize("side", ["height", "width", "channels"])
def test_a_camera_whose_images_are_empty_has_no_picture(side: str) -> None:
    sides = {"height": 4, "width": 4, "channels": 1, side: 0}
    empty = type("Empty", (Still,), sides)(image_of(PLATE))
    with robot(CServer(empty)) as session, asking_robot(session, find_nothing) as ask:
        assert ask().pictures == ()


class Short(Still):
    """A camera that gives fewer rows than it is asked for."""

    def rows(self, first: int, count: int) -> Image:
        return self.image.rows(first, count - 1)


def test_a_camera_that_leaves_out_rows_has_no_picture() -> None:
    short = CServer(Short(image_of(PLATE)))
    with robot(short) as session, asking_robot(session, find_nothing) as ask:
        assert ask().pictures == ()


def test_a_page_gets_the_pictures_of_all_cameras() -> None:
    cameras = [CServer(Still(image_of(PLATE)), address=name) for name in ("CServerFront", "CServerSide")]
    store = SnapshotStore(scene().modules)
    for snapshot in snapshots():
        store.add(snapshot)
    with robot(*cameras) as session:
        asker = Asker(lambda: asking_robot(session, find_signs), 0.001)
        watched = Watched(scene=scene(), store=store, is_live=True, asker=asker)
        with served(watched) as server, page(server.host) as opened:
            pictures = opened.until(lambda m: len(m.get("seen", {}).get("pictures", ())) == 2)["seen"][
                "pictures"
            ]
            assert [picture["camera"] for picture in pictures] == ["CServerFront", "CServerSide"]
            assert pictures[1]["found"][0]["label"] == "376"
            assert b64decode(pictures[0]["pixels"]) == image_of(PLATE).pixels
            opened.ask(do="pause")
            until(lambda: asker.answers is not None, "the robot is asked while the page is open")
        until(lambda: asker.answers is None, "it is not asked without a page")
        asker.close()
    store.close()


class Asked:
    """Counts questions. Mutable."""

    def __init__(self) -> None:
        self.questions = self.opened = self.closed = 0

    @contextmanager
    def open(self) -> Iterator[Ask]:
        self.opened += 1
        yield self.ask
        self.closed += 1

    def ask(self) -> RobotView:
        self.questions += 1
        return RobotView(pictures=(picture_of("CServer", image_of(PLATE), find_nothing),), ellipse=None)


def test_the_robot_is_asked_only_while_a_page_is_open() -> None:
    asked = Asked()
    asker = Asker(asked.open, 0.001)
    assert asked.opened == 0
    with asker.page():
        until(lambda: asked.questions > 3, "it is asked again and again")
        with asker.page():
            pass
        before = asked.questions
        until(lambda: asked.questions > before, "a page that remains is enough")
    until(lambda: asked.closed == 1, "the connections are closed with the last page")
    until(lambda: asker.answers is None, "nothing is left to send")
    with asker.page():
        until(lambda: asked.opened == 2, "the next page opens them again")
    asker.close()
    assert asked.closed == 2
    assert not any(thread.name == "asker" for thread in threading.enumerate())


def test_questions_are_as_rare_as_their_interval() -> None:
    asked = Asked()
    asker = Asker(asked.open, 1000.0)
    with asker.page():
        until(lambda: asker.answers is not None, "it is asked once")
        with asker.page():
            pass
    asker.close()
    assert asked.questions == 1


def test_a_page_gets_the_ellipse_of_the_pose_that_the_estimator_published() -> None:
    pose = PoseEstimate(2_000_000_000, 100.0, 200.0, 90.0, 900.0, 0.0, 0.0, 400.0, 0.0, 4.0)
    store = SnapshotStore(scene().modules)
    for snapshot in snapshots():
        store.add(snapshot)
    with robot(DServer()) as session, session.connect("DServer") as variables:
        asker = Asker(lambda: asking_robot(session, find_nothing), 0.001)
        watched = Watched(scene=scene(), store=store, is_live=True, asker=asker)
        with served(watched) as server, page(server.host) as opened:
            nothing = {"pictures": [], "ellipse": None, "troubles": []}
            assert opened.until(lambda m: "seen" in m)["seen"] == nothing
            variables.do(data.set(POSE, pose_list(pose)))
            found = opened.until(lambda m: m.get("seen", {}).get("ellipse"))["seen"]["ellipse"]
            assert (found["t"], found["x"], found["y"], found["heading"]) == (2.0, 100.0, 200.0, 90.0)
            assert found["major"] == pytest.approx(30.0 * 2.4477, rel=1e-4)
            variables.do(data.set(POSE, "lost"))
            opened.until(lambda m: "seen" in m and m["seen"]["ellipse"] is None)
        asker.close()
    store.close()
