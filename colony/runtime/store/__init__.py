"""Durable state of a server: stores of keys and bytes, and the journal that commits to them."""
