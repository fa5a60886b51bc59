"""The JSON schemas of the messages: those that Foxglove knows by name, with the members that we send.

Names, titles and encodings are Foxglove's (https://docs.foxglove.dev/docs/sdk/schemas).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

Schema = Mapping[str, Any]

NUMBER: Schema = {"type": "number"}
INTEGER: Schema = {"type": "integer"}
TEXT: Schema = {"type": "string"}
FLAG: Schema = {"type": "boolean"}


def record(title: str, **members: Schema) -> Schema:
    """Return the schema of an object with these members, all required."""
    return {"title": title, "type": "object", "properties": members, "required": list(members)}


def optional(title: str, members: Mapping[str, Schema]) -> Schema:
    """Return the schema of an object that may lack members."""
    return {"title": title, "type": "object", "properties": dict(members)}


def array(items: Schema) -> Schema:
    """Return the schema of an array."""
    return {"type": "array", "items": items}


_TIME = record("time", sec=INTEGER, nsec=INTEGER)
_DURATION = record("duration", sec=INTEGER, nsec=INTEGER)
_VECTOR = record("foxglove.Vector3", x=NUMBER, y=NUMBER, z=NUMBER)
_QUATERNION = record("foxglove.Quaternion", x=NUMBER, y=NUMBER, z=NUMBER, w=NUMBER)
_POSE = record("foxglove.Pose", position=_VECTOR, orientation=_QUATERNION)
_COLOR = record("foxglove.Color", r=NUMBER, g=NUMBER, b=NUMBER, a=NUMBER)
_POINT = record("foxglove.Point3", x=NUMBER, y=NUMBER, z=NUMBER)
_NOTHING = array({"type": "object"})
_LINE = record(
    "foxglove.LinePrimitive",
    type=INTEGER,
    pose=_POSE,
    thickness=NUMBER,
    scale_invariant=FLAG,
    points=array(_POINT),
    color=_COLOR,
    colors=array(_COLOR),
    indices=array(INTEGER),
)
_SPHERE = record("foxglove.SpherePrimitive", pose=_POSE, size=_VECTOR, color=_COLOR)
_ENTITY = record(
    "foxglove.SceneEntity",
    timestamp=_TIME,
    frame_id=TEXT,
    id=TEXT,
    lifetime=_DURATION,
    frame_locked=FLAG,
    metadata=_NOTHING,
    arrows=_NOTHING,
    cubes=_NOTHING,
    spheres=array(_SPHERE),
    cylinders=_NOTHING,
    lines=array(_LINE),
    triangles=_NOTHING,
    texts=_NOTHING,
    models=_NOTHING,
)
_FIELD = record("foxglove.PackedElementField", name=TEXT, offset=INTEGER, type=INTEGER)

WELL_KNOWN: Mapping[str, Schema] = {
    schema["title"]: schema
    for schema in (
        record(
            "foxglove.LaserScan",
            timestamp=_TIME,
            frame_id=TEXT,
            pose=_POSE,
            start_angle=NUMBER,
            end_angle=NUMBER,
            ranges=array(NUMBER),
            intensities=array(NUMBER),
        ),
        record(
            "foxglove.FrameTransform",
            timestamp=_TIME,
            parent_frame_id=TEXT,
            child_frame_id=TEXT,
            translation=_VECTOR,
            rotation=_QUATERNION,
        ),
        record("foxglove.PoseInFrame", timestamp=_TIME, frame_id=TEXT, pose=_POSE),
        record("foxglove.SceneUpdate", deletions=_NOTHING, entities=array(_ENTITY)),
        record(
            "foxglove.Grid",
            timestamp=_TIME,
            frame_id=TEXT,
            pose=_POSE,
            column_count=INTEGER,
            cell_size=record("foxglove.Vector2", x=NUMBER, y=NUMBER),
            row_stride=INTEGER,
            cell_stride=INTEGER,
            fields=array(_FIELD),
            data={"type": "string", "contentEncoding": "base64"},
        ),
        record(
            "foxglove.Log",
            timestamp=_TIME,
            level=INTEGER,
            message=TEXT,
            name=TEXT,
            file=TEXT,
            line=INTEGER,
        ),
    )
}
"""The schemas that Foxglove draws, by name."""
