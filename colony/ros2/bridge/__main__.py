"""The process of the bridge: `python colony/ros2/bridge DESCRIPTOR`, with the Python of a ROS environment.

That Python may be older than colony's. It therefore finds empty packages in the place of `colony` and
`colony.ros2`, and imports nothing but the modules of this folder.
"""

from __future__ import annotations

import importlib
import socket
import sys
from pathlib import Path
from types import ModuleType

HERE = Path(__file__).resolve().parent


def main() -> None:
    """Run the bridge over the end of a socket pair that this process was given."""
    sys.path[:] = [
        path for path in sys.path if Path(path) != Path(__file__).parent
    ]  # it may hide modules of ROS
    for name, folder in (("colony", HERE.parent.parent), ("colony.ros2", HERE.parent)):
        package = ModuleType(name)
        package.__path__ = [str(folder)]
        sys.modules[name] = package
    node = importlib.import_module("colony.ros2.bridge.node")
    node.run(socket.socket(fileno=int(sys.argv[1])))


if __name__ == "__main__":
    main()
