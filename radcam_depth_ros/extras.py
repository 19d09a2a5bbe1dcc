"""Says which extra of this package brings a package that is missing."""

from __future__ import annotations


def install_extra(extra: str) -> str:
    """What to do where a package of an extra is missing, as the end of a sentence.

    Args:
        extra: A key of `extras_require` in setup.py.
    """
    return f"install the extra `{extra}`: pip install 'radcam-depth-ros[{extra}]'"
