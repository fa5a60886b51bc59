from __future__ import annotations

from collections.abc import Generator
from typing import Any

import numpy as np
import pytest

from colony.runtime.kit.errors import CallRefusedError, CallTimeoutError
from colony.runtime.kit.script import Do, Step
from colony.runtime.library import camera
from colony.runtime.protocol.images import Image
from colony.vision.lights.ceiling_camera import UPWARD
from colony.vision.lights.observing import CeilingObservation, ceiling_observer, ensure_period
from colony.vision.lights.tracker import light_tracker
from tests.vision.lights.corridors import Ceiling, Robot, Stage, rendered

LIGHTS = (2000.0, 7500.0)
LIT = Ceiling(lights=tuple((place, 240.0) for place in LIGHTS))


def image(t_ns: int) -> Image:
    pixels = np.zeros((120, 240), dtype=np.uint8)
    lit = Ceiling(lights=((0.0, 240.0),))
    pixels[list(UPWARD.scan_rows)] = rendered(lit, np.random.default_rng(0), along_mm=0.0)
    return Image(t_ns=t_ns, height=120, width=240, channels=1, pixels=pixels.tobytes())


def answered(
    look: Generator[Step, Any, tuple[CeilingObservation, ...]], times: list[int]
) -> tuple[tuple[CeilingObservation, ...], int]:
    """What a look gives, if what it asks for is of images of these times, and how often it asked."""
    asked, band = 0, None
    try:
        while True:
            step = look.send(band)
            assert isinstance(step, Do)
            assert isinstance(step.call.arguments, camera.GrabRows)
            band = image(times[asked]).rows(step.call.arguments.first, step.call.arguments.count)
            asked += 1
    except StopIteration as done:
        return done.value, asked


def test_three_rows_of_one_image_are_all_that_is_asked() -> None:
    ((look,), asked) = answered(ceiling_observer(["CServerUp"], [UPWARD])(0.0), [5] * 3)
    assert asked == 3
    assert look.t_ns == 5
    assert [round(light.ahead_mm, -1) for light in look.lights] == [0.0]


def test_rows_of_different_images_are_asked_again() -> None:
    ((look,), asked) = answered(ceiling_observer(["CServerUp"], [UPWARD])(0.0), [5, 6, 6, 6])
    assert (look.t_ns, asked) == (6, 4)


def test_a_camera_that_is_too_fast_shows_nothing() -> None:
    looks, asked = answered(ceiling_observer(["CServerUp"], [UPWARD])(0.0), list(range(9)))
    assert (looks, asked) == ((), 9)


def test_no_image_is_looked_at_twice() -> None:
    looker = ceiling_observer(["CServerUp"], [UPWARD])
    assert len(answered(looker(0.0), [5] * 3)[0]) == 1
    assert answered(looker(0.0), [5] * 3)[0] == ()


@pytest.mark.parametrize("problem", [CallRefusedError("no image", "none yet"), CallTimeoutError("no answer")])
def test_a_camera_that_does_not_answer_does_not_blind_the_others(problem: Exception) -> None:
    looker = ceiling_observer(["Broken", "CServerUp"], [UPWARD, UPWARD])

    def broken() -> Generator[Step, Any, tuple[CeilingObservation, ...]]:
        """The look, with what only the first camera is asked taken out of it."""
        look = looker(0.0)
        step = next(look)
        assert isinstance(step, Do)
        assert step.server == "Broken"
        band = yield look.throw(problem)
        try:
            while True:
                band = yield look.send(band)
        except StopIteration as done:
            looks: tuple[CeilingObservation, ...] = done.value
            return looks

    looks, asked = answered(broken(), [7] * 3)
    assert [look.t_ns for look in looks] == [7]
    assert asked == 3


def test_cameras_are_hurried_only_where_they_are_too_slow() -> None:
    stage = Stage(LIT, Robot(), {"tracker": light_tracker()}, seed=1, goals=[LIGHTS])
    stage.run(1.0)
    assert stage.camera_period_s("CServerUp") == 0.25
    stage = Stage(LIT, Robot(), {"slow": ensure_period(("CServerUp",), 1.0)}, seed=1, goals=[LIGHTS])
    stage.run(1.0)
    assert stage.camera_period_s("CServerUp") == 0.5
