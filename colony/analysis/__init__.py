"""Runs followed in the interpreter, from recordings or robots: audits, and moments to explain."""
