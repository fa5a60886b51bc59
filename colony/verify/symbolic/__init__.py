"""What a program means, as formulas for z3: one frame, from the memory before it to the memory after it."""
