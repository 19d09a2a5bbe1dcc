"""A drive through the live node: `python -m demo`, or `make demo`."""
