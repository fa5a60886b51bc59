"""Pioneer robots of ActivMedia and MobileRobots, with PSOS, P2OS, AROS or ARCOS."""
