"""The runtime of a robot: its protocol, nodes, servers, clients, recordings and transports."""
