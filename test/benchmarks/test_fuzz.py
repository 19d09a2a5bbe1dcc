from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from benchmarks.fuzz import Fuzz
from radcam_depth_ros.estimator import Estimator, EstimatorConfig
from radcam_depth_ros.frame_builder import builder


@pytest.fixture(scope="module")
def estimator(small_weights: Path) -> Estimator:
    return Estimator(EstimatorConfig(model_file=str(small_weights), precision="float32"))


def test_wrong_messages_give_sentences_alone_and_the_next_good_pair_gives_its_depth(estimator: Estimator) -> None:
    figures = Fuzz(estimator, seed=20, good_every=500).run(2000)
    assert figures.defects == []
    assert figures.pairs_needed == {1: 8}
    assert figures.frames > 100
    assert {"good Image", "lying Image", "lying PointCloud2", "changed TFMessage"} < figures.kinds.keys()
    assert sum(counts["refused"] for counts in figures.kinds.values()) > 500
    assert figures.memory_mib[1] - figures.memory_mib[0] < 64


def test_a_defect_is_told_with_how_to_repeat_it(estimator: Estimator, monkeypatch: pytest.MonkeyPatch) -> None:
    fuzz = Fuzz(estimator, seed=20)

    def fail(*_: Any) -> None:
        raise ZeroDivisionError("oh")

    monkeypatch.setattr(builder, "decode_radar", fail)
    defects = fuzz.run(50).defects
    assert defects[0].problem == "ZeroDivisionError: oh"
    assert defects[0].repeat == f"python -m benchmarks.fuzz --seed 20 --first {defects[0].number} --messages 1"
    assert "a good pair gave no frame" in [defect.problem for defect in defects]
