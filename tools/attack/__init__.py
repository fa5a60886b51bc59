"""Attacks on a robot of real processes, through its gateway and around it; `make attack` runs all of them."""
