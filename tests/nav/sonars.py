"""The sonars of RoME, as the navigation models them."""

from __future__ import annotations

from colony.nav.pose.echoes import SonarRing, rome_sonars

SONARS = rome_sonars()
CHANNELS = SONARS.count
RING = SonarRing(SONARS)
