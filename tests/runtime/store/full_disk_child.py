"""A store on a disk that a test fills: `python -m tests.runtime.store.full_disk_child STORE`.

It reads commands from its input, and answers each with a line of JSON.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

from colony.runtime.store.sqlite import SqliteStore
from colony.runtime.store.store import Key, StoreError


def main(path: str) -> None:
    store: SqliteStore | None = None
    for line in sys.stdin:
        verb, *arguments = json.loads(line)
        answer: object = None
        try:
            if verb == "open":
                store = SqliteStore(Path(path))
            elif verb == "put":
                name, size = arguments
                assert store is not None
                store.commit({Key("value", name): name.encode() * size})
            elif verb == "room":
                assert store is not None
                store.check_space()
            elif verb == "names":
                assert store is not None
                answer = sorted(key.name for key, _ in store.load())
            elif verb == "close":
                assert store is not None
                store.close()
            problem = None
        except StoreError as failed:
            problem = f"{type(failed).__name__}: {failed}"
        full = None if store is None else store.full
        print(json.dumps({"answer": answer, "full": full, "problem": problem}), flush=True)


if __name__ == "__main__":
    main(sys.argv[1])
