"""The transports that carry messages between nodes: zenoh in live runs, a seeded queue in virtual time."""
