"""Reactive robot behavior: modules wired through suppressors and inhibitors, as prioritized clients."""

__version__ = "0.1.0"
