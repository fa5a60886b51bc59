"""The training of the network that reads door plates: `python -m tools.training`."""
