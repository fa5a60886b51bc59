"""The network that reads the characters of a plate, and the decoding of its output."""
