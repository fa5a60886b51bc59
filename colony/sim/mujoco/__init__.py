"""A robot in MuJoCo, a physics that is not ours: its wheels drive by friction (docs/physics.md)."""
