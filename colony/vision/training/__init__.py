"""How the network that reads door plates is trained: `python -m colony.vision.training`."""
