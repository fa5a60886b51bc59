"""The meaning of a program as formulas for z3: one frame, from the memory before it to that after it."""
