"""Lowering of the typed program and its clients to code."""
