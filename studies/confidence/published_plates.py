"""The eleven walks of the thesis past door number plates, as published in its Table 6.3.

Section 6.3 counts 132 plates that were detected after the first one of a walk, 19 that were missed and 11
false ones, 162 in all. With the first plates of the eleven walks, the lists have 143 detected plates. There
are 11 false ones if the nine labels from a wall of glass bricks count as one.
"""

from __future__ import annotations

import re
from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class PublishedWalk:
    """A walk, and the plates found on it.

    Attributes:
        origin, goal: nodes of `maps/msu_engineering_3.stickrep`.
        found, missed: texts of the plates. Three were elevators', and some doors had two plates ("350.1",
            "350.2"), which the map does not have.
        false: false detections and their positions; a number is a plate that was counted twice.
    """

    origin: str
    goal: str
    found: tuple[str, ...]
    missed: tuple[str, ...]
    false: tuple[str, ...]


# Entries that are illegible in print were inferred from the other walks along the same wall: on walk 4 the
# last plate is 341; on walk 6 the second 320 may be 322, and is kept; walk 5 ends at "V317R", which is 317R;
# on walk 8 "364, 350.1 350.2" is 346, 350.1, 350.2, the order along the walk.
_TABLE = """
352L 384R
  found  352 354 356 360 364 368 elev 372 376 380 382 384
  missed 358 364.double
  false  a black poster between 364.double and 364
381L NE.men.L
  found  381 379 377 375 373 371 369 367 363 361 359 357 355 349 347 345 343 339
  missed 353 351 341
346R 376R
  found  350.1 350 352 354 356 358 360 364.double 364 368 old.elevator 372 376
  false  356; 364
381R NE.men.R
  found  381 379 377 375 371 369 367 361 359 357 355 353 351 349 347 345 341
  missed 373 363 343 339
NE.women.L 317R
  found  335 329 327 325 323 317.1
  missed 317.2
  false  between 335 and 329
314L 340.cmptr.room.R
  found  314 320 320 326 340.cmptr.room
  missed 324 340
A342L A323R
  found  A342 A340 A339 A338 A336 A335 A334 A332 A331 A330 A328 A326 A325 A324 A323
  missed A327
  false  A342; A340
acs.elev.R 376R
  found  346 350.1 350.2 352 354 356 358 360 364.1 364.2 368 372 376
  false  356; between 364.1 and 364.2
381R NE.men.R
  found  381 379 377 375 373 371 369 367 363 361 359 357 355 353 351 347 345 343 339
  missed 349 341
  false  a poster on 377; a poster on 371
NE.women.L 311.double.R
  found  335 329 327 325 323 317.1 317.2 311
A365L 301R
  found  A365 A367 A368 A371 A372 A373 A377 A378 A379 A380 A381 A383 A385 A391 A393 A395 301
  missed A369 A375 A382 A397
  false  glass bricks, nine times, counted once
"""


def _walk(block: str) -> PublishedWalk:
    head, *lines = block.splitlines()
    origin, goal = head.split()
    plates = dict(line.split(maxsplit=1) for line in lines)
    return PublishedWalk(
        origin=origin,
        goal=goal,
        found=tuple(plates["found"].split()),
        missed=tuple(plates.get("missed", "").split()),
        false=tuple(plates["false"].split("; ")) if "false" in plates else (),
    )


PUBLISHED_WALKS: tuple[PublishedWalk, ...] = tuple(map(_walk, re.split(r"\n(?=\S)", _TABLE.strip())))
