"""The live page of a robot, and of recordings: `colony watch`."""
