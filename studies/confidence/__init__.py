"""Probabilistic automata that give the confidence of a plan (thesis section 6.3)."""
