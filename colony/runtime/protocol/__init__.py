"""The protocol between the nodes of a robot: messages, their encoding, topics, calls and deployments."""
