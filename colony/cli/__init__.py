"""The command line: one module per command. It wires all packages, and no package imports it."""
