"""The transport over zenoh: hosts of nodes, the gateway, and the files that they share on a machine."""
