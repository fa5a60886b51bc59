"""Passes of the compiler, from the network to clients with guards."""
