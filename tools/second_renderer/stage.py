"""What a scene is made of: shapes for Mitsuba, and the things in it that a detector should find.

Lengths are in meters. x leads away from the wall that the camera looks at, y along it, to the right
when facing it, z up from the floor; that wall is the plane x = 0.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, NamedTuple

import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from tools.second_renderer.lettering import Picture, Print

mi.set_variant("scalar_rgb")

Vector = NDArray[np.float64]
Material = dict[str, Any]


class Target(NamedTuple):
    """A thing to be found: `kind` plate, marker or light; `label` its text or code, or whether it is on.

    `corners` are in space, from the upper left one clockwise facing it.
    """

    kind: str
    label: str | int | bool
    corners: NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Stage:
    """A scene that is being built: shapes and emitters by name, and the targets among them."""

    parts: dict[str, Any] = field(default_factory=dict)
    targets: list[Target] = field(default_factory=list)

    def add(self, part: dict[str, Any]) -> None:
        """Put something into the scene."""
        self.parts[f"part{len(self.parts)}"] = part

    def sheet(self, corner: Vector, right: Vector, up: Vector, material: Material, **more: Any) -> None:
        """A flat rectangle from its lower left corner; it faces right x up."""
        center = corner + (right + up) / 2.0
        normal = np.cross(right, up)
        matrix = np.eye(4)
        matrix[:3, 0], matrix[:3, 1] = right / 2.0, up / 2.0
        matrix[:3, 2], matrix[:3, 3] = normal / np.linalg.norm(normal), center
        self.add(
            {"type": "rectangle", "to_world": mi.ScalarTransform4f(matrix.tolist()), "bsdf": material, **more}
        )

    def box(self, low: tuple[float, float, float], high: tuple[float, float, float], bsdf: Material) -> None:
        """A box along the axes."""
        low_, high_ = np.array(low), np.array(high)
        matrix = np.diag([*((high_ - low_) / 2.0), 1.0])
        matrix[:3, 3] = (low_ + high_) / 2.0
        self.add({"type": "cube", "to_world": mi.ScalarTransform4f(matrix), "bsdf": bsdf})

    def on_wall(self, y: float, z: float, width: float, height: float, material: Material, *,
                off: float = 0.0, **more: Any) -> NDArray[np.float64]:  # fmt: skip
        """A flat thing on the wall, from its lower left corner, so far off the wall; its corners."""
        corner, right, up = np.array([off, y, z]), np.array([0.0, width, 0.0]), np.array([0.0, 0.0, height])
        self.sheet(corner, right, up, material, **more)
        return np.array([corner + up, corner + up + right, corner + right, corner])

    def ball(self, center: tuple[float, float, float], radius: float, bsdf: Material) -> None:
        """A sphere."""
        self.add({"type": "sphere", "center": list(center), "radius": radius, "bsdf": bsdf})

    def tube(self, start: tuple[float, float, float], end: tuple[float, float, float], radius: float,
             bsdf: Material) -> None:  # fmt: skip
        """A cylinder from one point to another."""
        self.add({"type": "cylinder", "p0": list(start), "p1": list(end), "radius": radius, "bsdf": bsdf})


def matte(color: float | tuple[float, float, float]) -> Material:
    """A rough surface of one color."""
    return {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": _rgb(color)}}


def glossy(color: float | tuple[float, float, float], roughness: float) -> Material:
    """A varnished surface of one color: plastic, linoleum, lacquer."""
    plastic = {"type": "roughplastic", "diffuse_reflectance": _rgb(color), "alpha": roughness}
    return {"type": "twosided", "bsdf": plastic}


def steel(roughness: float) -> Material:
    """Brushed steel."""
    metal = {"type": "roughconductor", "material": "Cr", "alpha": roughness}
    return {"type": "twosided", "bsdf": metal}


def printed(sheet: Print, size: tuple[float, float], *, roughness: float | None = None) -> Material:
    """A surface with a picture on it, tiled where the surface, in meters, is larger than the picture."""
    texture = _texture(sheet.picture, (1000.0 * size[0] / sheet.width_mm, 1000.0 * size[1] / sheet.height_mm))
    if roughness is None:
        return {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": texture}}
    plastic = {"type": "roughplastic", "diffuse_reflectance": texture, "alpha": roughness}
    return {"type": "twosided", "bsdf": plastic}


def glowing(picture: Picture, strength: float) -> dict[str, Any]:
    """The emitter of a surface that shines as a picture says."""
    return {"type": "area", "radiance": _texture(picture * strength, (1.0, 1.0), linear=True)}


def lamp(strength: float) -> dict[str, Any]:
    """The emitter of a surface that shines evenly."""
    return {"type": "area", "radiance": _rgb(strength)}


def _texture(picture: Picture, tiles: tuple[float, float], *, linear: bool = False) -> dict[str, Any]:
    # What is printed is given as reflectance, so nothing is to be converted from a screen's levels.
    bitmap = mi.Bitmap(np.ascontiguousarray(picture[::-1], dtype=np.float32))
    scale = mi.ScalarTransform4f().scale([tiles[0], tiles[1], 1.0])
    return {"type": "bitmap", "bitmap": bitmap, "raw": linear, "to_uv": scale, "wrap_mode": "repeat"}


def _rgb(color: float | tuple[float, float, float]) -> dict[str, Any]:
    values = [color] * 3 if isinstance(color, float) else list(color)
    return {"type": "rgb", "value": [float(c) for c in values]}
