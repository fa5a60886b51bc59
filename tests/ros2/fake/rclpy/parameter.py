def Parameter(name, value=None):  # noqa: N802
    return name, value
