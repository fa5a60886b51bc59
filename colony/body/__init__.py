"""The bodies of robots: shape, drive and devices, which an interface in the language does not say."""
