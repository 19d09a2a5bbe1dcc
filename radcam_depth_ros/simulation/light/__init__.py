"""Light: sun, sky, lamps, and the shading of surfaces."""
