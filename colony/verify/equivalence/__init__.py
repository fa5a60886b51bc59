"""Translation validation: a proof that every compiled form of a program does what its network says.

The entry point is `prove` (`prove.py`). `network.py` encodes what the network means, the readers (`table.py`,
`json_text.py`, `lowered.py`, `python_text.py`) what each compiled form does, and `circuit.py`,
`formula_index.py`, `solver.py` and `priorities.py` show that these are the same.
"""
