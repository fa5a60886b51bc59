"""Checking of syntax trees to the typed program: a file per kind of declaration, led by `program.py`."""
