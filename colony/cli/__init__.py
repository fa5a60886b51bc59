"""The command line: one file a command. It wires everything, and nothing imports it."""
