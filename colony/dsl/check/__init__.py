"""Checking: syntax trees to the typed program. One file a kind of declaration, `program.py` in front."""
