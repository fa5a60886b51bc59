"""The cameras of the simulated robots."""
