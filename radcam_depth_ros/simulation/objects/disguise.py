"""Random colours for all materials, so that depth cannot be learned from usual colours."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from radcam_depth_ros.simulation.materials.surfaces import Surface
from radcam_depth_ros.simulation.objects.mesh import Mesh

_SHADES = 6


class Disguise:
    """Other colours for all materials of a world: like stays like, so that shapes can still be seen."""

    def __init__(self, rng: np.random.Generator) -> None:
        """Draws a colour for each surface, texture and shade."""
        tone = np.exp(rng.uniform(np.log(0.03), np.log(0.8), (len(Surface), 256, _SHADES, 1)))
        tint = np.exp(rng.normal(0, 0.5, (len(Surface), 256, _SHADES, 3)))
        self._colours = np.clip(tone * tint, 0.01, 0.95).astype(np.float32)

    def worn_by(self, mesh: Mesh) -> Mesh:
        """The mesh in its other colours."""
        brightness = mesh.colour.mean(axis=1)
        step = np.log2(np.maximum(brightness, 1e-3)) + 8.0
        shade = np.clip(step.astype(np.int64) % _SHADES, 0, _SHADES - 1)
        # What remains of the brightness within a step keeps the leaves of a tree apart.
        rest = (0.75 + 0.5 * (step - np.floor(step)))[:, None].astype(np.float32)
        return replace(mesh, colour=np.minimum(self._colours[mesh.surface, mesh.texture, shade] * rest, 1.0))
