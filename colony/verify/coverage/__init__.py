"""Coverage of behaviors: which parts of a program its tests, or recordings, have exercised."""
