"""Arbitration of actuators: the choice of one command per frame, locks, and the emergency stop."""
