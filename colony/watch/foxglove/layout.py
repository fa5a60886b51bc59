"""A layout of Foxglove for the topics of a program: the robot in 3D, commands, who commands, and the log."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from colony.watch.foxglove.shapes import BASE, MAP
from colony.watch.scene import PageScene

_STAMP = "receiveTime"


def layout_of(scene: PageScene, topics: Sequence[str]) -> Mapping[str, Any]:
    """Return the layout as Foxglove imports it.

    Args:
        scene: what is shown of the program.
        topics: the topics of its messages.
    """
    drawn = [t for t in topics if t.startswith("/scans/") or t in _DRAWN]
    panels: dict[str, Mapping[str, Any]] = {
        "3D!colony": {
            "followTf": BASE,
            "followMode": "follow-position",
            "scene": {},
            "topics": {t: {"visible": True, **_settings(t)} for t in drawn},
            "cameraState": {"perspective": False, "distance": 12, "phi": 0, "thetaOffset": 0},
            "layers": {},
            "fixedFrame": MAP if scene.has_pose else BASE,
        }
    }
    plots = []
    for actuator in scene.actuators:
        fields = [f for f in actuator.fields if not f.words]
        if fields:
            plots.append(name := f"Plot!{actuator.name}")
            names = [n for f in fields for n in (f.name, f"{f.name}_low", f"{f.name}_high")]
            panels[name] = {
                "paths": [_path(f"/actuators/{actuator.name}.{n}") for n in names],
                "showLegend": True,
                "isSynced": True,
                "xAxisVal": "timestamp",
                "foxglovePanelTitle": actuator.name,
            }
    winners = [_path(f"/actuators/{a.name}.by") for a in scene.actuators]
    states = [_path(f"/states.{_quoted(s.name)}") for s in scene.states]
    panels["StateTransitions!colony"] = {"paths": [*winners, *states], "isSynced": True}
    panels["RosOut!colony"] = {"topicToRender": "/log", "minLogLevel": 1, "searchTerms": []}
    right = _split("column", ["StateTransitions!colony", *plots, "RosOut!colony"])
    return {
        "configById": panels,
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": {"speed": 1},
        "layout": {"direction": "row", "first": "3D!colony", "second": right, "splitPercentage": 55},
    }


_DRAWN = ("/footprint", "/zones", "/path", "/goal", "/map", "/pose", "/tf")


def _settings(topic: str) -> Mapping[str, Any]:
    if topic.startswith("/scans/"):
        return {"pointSize": 4, "colorMode": "flat", "flatColor": "#d55e00"}
    if topic == "/map":
        ends = {"minValue": 0, "maxValue": 100}
        return {"colorField": "wall", "colorMode": "gradient", "gradient": ["#00000000", "#404040ff"], **ends}
    return {}


def _path(value: str) -> Mapping[str, Any]:
    return {"value": value, "enabled": True, "timestampMethod": _STAMP}


def _quoted(name: str) -> str:
    """Return the name of a member in a message path; one with a dot is quoted."""
    return f'"{name}"' if "." in name else name


def _split(direction: str, panels: Sequence[str]) -> Any:
    """Return panels one after the other, all of the same size."""
    if len(panels) == 1:
        return panels[0]
    rest = _split(direction, panels[1:])
    return {"direction": direction, "first": panels[0], "second": rest, "splitPercentage": 100 / len(panels)}
