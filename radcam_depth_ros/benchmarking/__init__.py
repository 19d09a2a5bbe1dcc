"""Measures a network's speed on this machine: its sections, the whole, and against another form of it."""
