"""Translation validation: a proof that every compiled form of a program does what its network says.

`prove` is the way in (`prove.py`); `source.py` says what the network means, the readers (`table.py`,
`json_text.py`, `lowered.py`, `python_text.py`) what each compiled form does, and `circuit.py`, `matching.py`,
`solver.py` and `priorities.py` show that these are the same.
"""
