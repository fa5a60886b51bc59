"""The policy for losses, over many seeds of programs, faults and operators: `python -m tools.loss`."""
