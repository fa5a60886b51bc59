"""The simulated world: robots, people, doors and elevators in a building."""
