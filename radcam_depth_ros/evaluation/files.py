"""Writing a result so that nobody ever reads half of it."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path

from radcam_depth_ros.evaluation.metrics import EvaluationError


def write_text(path: Path | str, text: str) -> None:
    """Writes a UTF-8 file under a temporary name beside its place, then renames it; makes the folder.

    Raises:
        EvaluationError: when the file cannot be written; nothing is left then.
    """
    target = Path(path)
    temporary = target.with_name(f".{target.name}.{os.getpid()}.part")
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        temporary.write_text(text, encoding="utf-8")
        temporary.replace(target)
    except OSError as error:
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)
        raise EvaluationError(f"cannot write {target}: {error.strerror}; choose a place that can be written") from None
