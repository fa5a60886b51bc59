"""The training of the network that reads door plates: `python -m colony.vision.training`."""
