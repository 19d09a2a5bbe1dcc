"""Settings of a simulated drive, the street's style, and random streams."""
