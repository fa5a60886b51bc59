"""The assembly of a robot from its parts: one loop, nodes in virtual time, or processes."""
