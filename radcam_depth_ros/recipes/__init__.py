"""Recipes of training, a YAML file each: `baff` has every value, the others what differs, and their own losses."""

from importlib import resources
from pathlib import Path


def shipped(name: str) -> Path | None:
    """File of a recipe that comes with the package; None where there is none of that name."""
    path = Path(str(resources.files(__name__))) / f"{name}.yaml"
    return path if path.is_file() else None
