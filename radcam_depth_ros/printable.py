"""Shows text that others gave - topics, frames, fields, paths - without obeying what is in it."""

from __future__ import annotations


def printable(text: str) -> str:
    r"""A text on one line, whose control characters are spelled out.

    A topic's name may hold a line break, a terminal's escape sequence or a mark that reverses the line: shown as they
    are, they would forge lines of a log, or of a parameter file.

    Args:
        text: Anything.

    Returns:
        The same with all that is not printable written as Python's `repr` has it, such as \\n, \\x1b or \\u202e.
    """
    if text.isprintable():
        return text
    return "".join(letter if letter.isprintable() else ascii(letter)[1:-1] for letter in text)
