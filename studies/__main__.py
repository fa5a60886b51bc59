"""`python -m studies LIST [options]`."""

from __future__ import annotations

from studies.command import command

if __name__ == "__main__":
    command(prog_name="python -m studies")
