"""The codes of everything that is reported outside of the front end, each with what it is about.

Codes are stable: a code keeps its meaning, and one that is given up is not used again. `docs/errors.md`
tells of each when it occurs and how to mend it. M is about maps, F about the frames of a trace, R about
binding a program to a robot, P about modules written in Python, T about what tests found, A about recordings
to be audited. The front end's own are in `colony.dsl.errors`.
"""

from __future__ import annotations

CODES: dict[str, str] = {
    "M001": "the map cannot be read",
    "M002": "the map is not text",
    "M003": "the file is no StickRep map",
    "M004": "an unknown header line",
    "M005": "a header line is given twice",
    "M006": "a part of the map is missing",
    "M007": "a header or ring line is malformed",
    "M008": "not a name",
    "M009": "not a number, or one outside its bounds",
    "M010": "a row is too short",
    "M011": "an unknown type of edge",
    "M012": "offsets and length do not follow the number of lights",
    "M013": "a row stands outside of any ring",
    "M014": "a node's name is used twice",
    "M015": "a ring's name is used twice",
    "M016": "a ring has too few edges",
    "M017": "a ring does not turn full circle",
    "M018": "a ring does not end where it began",
    "M019": "a light is beyond its edge",
    "M020": "the lights of turning spaces do not pair",
    "M021": "edges cross",
    "M022": "the start is not in free space",
    "M023": "too much for a map",
    "M024": "a ring is traced the wrong way round",
    "F001": "a line is not JSON",
    "F002": "a frame is not an object",
    "F003": "a frame has no proper time",
    "F004": "the time of frames does not rise",
    "F005": "an unknown sensor in a frame",
    "F006": "an array of the wrong length in a frame",
    "F007": "the frames are not text",
    "F008": "the frames cannot be read",
    "R001": "an unknown server",
    "R002": "an unknown field of a server",
    "R003": "the type is not that of the server",
    "R004": "an unknown command of a server",
    "R005": "an unknown parameter of a command",
    "R006": "two actuators have one command",
    "P001": "a class in Python cannot be imported and built",
    "T001": "an expectation is false",
    "T002": "an expectation says nothing",
    "T003": "a contract is broken in a test",
    "T004": "an element is set of an array that is missing",
    "A001": "the recording cannot be read",
    "A002": "the file is no recording of a run",
    "A003": "there is nothing to audit in a recording",
    "A004": "what is recorded is none of the program",
    "A005": "the program of a recording cannot be used",
}
