"""The entry point of `python -m colony`: the command line."""

from __future__ import annotations

from colony.cli.main import main

if __name__ == "__main__":
    main()
