"""Losses between the maps of a teacher and a student ([Sun2025], eq. 1 to 5)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import astuple, dataclass

from torch import Tensor
from torch.nn import functional

from radcam_depth_ros.networks import DistillationFeatures
from radcam_depth_ros.training.distributed.ranks import Ranks
from radcam_depth_ros.training.errors import TrainingError
from radcam_depth_ros.training.losses.masked import ALONE, halved, sample_mean
from radcam_depth_ros.training.losses.rectified import uncertainty


@dataclass(frozen=True)
class DistillationConfig:
    """Weights of what a teacher gives; 0 switches a term off, and then the networks need not fit there.

    Attributes:
        image: Of the image encoders' maps.
        radar: Of the radar encoders' maps, as they join the image's.
        decoder: Of the likeness of places within the decoders' maps.
        inter_depth: Of the depths within the decoders.
        beta: Of the uncertainty that weighs these: the relative difference at which it is 1 - 1 / e.
        cells: Along each side, the places that the decoders' maps are pooled to before they are compared.
    """

    image: float
    radar: float
    decoder: float
    inter_depth: float
    beta: float
    cells: int

    def __post_init__(self) -> None:
        if min(astuple(self)) < 0:
            raise TrainingError(f"values of the distillation must not be negative, got {min(astuple(self))}")
        if self.beta <= 0 or self.cells < 1:
            raise TrainingError(f"beta must be positive and cells at least 1, got {self.beta} and {self.cells}")


def features_of(outputs: object, network: str) -> DistillationFeatures:
    """What a network tells of its insides.

    Args:
        outputs: What its `train_outputs` gave.
        network: Its name, for the error.

    Raises:
        TrainingError: when it tells nothing.
    """
    features = getattr(outputs, "features", None)
    if not isinstance(features, DistillationFeatures):
        raise TrainingError(
            f"{network} can neither teach nor learn by distillation: its training outputs have no features; take "
            "cafnet or lircdepth, or leave distillation out"
        )
    return features


def distillation_loss(
    student: DistillationFeatures, teacher: DistillationFeatures, config: DistillationConfig, ranks: Ranks = ALONE
) -> tuple[Tensor, dict[str, Tensor]]:
    """All that the student can learn from the teacher; the teacher gets no gradient.

    Args:
        student: Of the network that learns.
        teacher: Of the one that teaches, for the same batch.
        config: Weights.
        ranks: The processes that share the batch; each gets its part of the losses, whose sum is that of the batch.

    Returns:
        The total, and its parts before weighting, by name; the parts pass no gradient.

    Raises:
        TrainingError: when the networks' maps do not fit each other.
    """
    total = student.inter_depth_m[0].new_zeros(())
    parts: dict[str, Tensor] = {}
    if config.image > 0:
        parts["distilled_image"] = feature_loss(student.image, teacher.image, "image", ranks)
        total = total + config.image * parts["distilled_image"]
    if config.radar > 0:
        parts["distilled_radar"] = feature_loss(student.radar, teacher.radar, "radar", ranks)
        total = total + config.radar * parts["distilled_radar"]
    if config.decoder > 0:
        parts["distilled_decoder"] = similarity_loss(student.decoder, teacher.decoder, config.cells, ranks)
        total = total + config.decoder * parts["distilled_decoder"]
    if config.inter_depth > 0:
        parts["distilled_depth"] = inter_depth_loss(student.inter_depth_m, teacher.inter_depth_m, config.beta, ranks)
        total = total + config.inter_depth * parts["distilled_depth"]
    return total, {name: part.detach() for name, part in parts.items()}


def feature_loss(student: Sequence[Tensor], teacher: Sequence[Tensor], name: str, ranks: Ranks = ALONE) -> Tensor:
    """Mean absolute difference of maps, halved from scale to scale beginning with 1/2 (eq. 1).

    The mean stands for the paper's norm, which would count the number of a map's values as well.
    """
    _check(student, teacher, name)
    terms = [
        sample_mean((mine.float() - theirs.detach().float()).abs(), ranks)
        for mine, theirs in zip(student, teacher, strict=True)
    ]
    return halved(terms)


def similarity_loss(student: Sequence[Tensor], teacher: Sequence[Tensor], cells: int, ranks: Ranks = ALONE) -> Tensor:
    """Squared difference of how alike places are, halved from scale to scale in the order of decoding (eq. 3).

    Maps are pooled to `cells` x `cells` places first (their means), since the matrix of all pairs of pixels of a whole
    image has up to 1e12 entries.
    """
    # How many channels a map has does not matter here.
    _check([x[:, :1] for x in student], [x[:, :1] for x in teacher], "decoder")
    terms = [
        sample_mean((_similarities(mine, cells) - _similarities(theirs.detach(), cells)).square(), ranks)
        for mine, theirs in zip(student, teacher, strict=True)
    ]
    return halved(terms)


def inter_depth_loss(
    student_m: Sequence[Tensor], teacher_m: Sequence[Tensor], beta: float, ranks: Ranks = ALONE
) -> Tensor:
    """Absolute difference of depths weighted by their uncertainty, halved in the order of decoding (eq. 5).

    The uncertainty is a weight and passes no gradient.
    """
    _check(student_m, teacher_m, "inter_depth_m")
    terms = []
    for mine, theirs in zip(student_m, teacher_m, strict=True):
        target = theirs.detach().float()
        weight = uncertainty(mine.detach().float(), target, beta)
        terms.append(sample_mean(weight * (mine.float() - target).abs(), ranks))
    return halved(terms)


def _similarities(x: Tensor, cells: int) -> Tensor:
    """Cosines between places, (B, cells cells, cells cells) (eq. 2)."""
    places = functional.adaptive_avg_pool2d(x.float(), cells).flatten(2)
    places = functional.normalize(places, dim=1)
    return places.transpose(1, 2) @ places


def _check(student: Sequence[Tensor], teacher: Sequence[Tensor], name: str) -> None:
    mine, theirs = ([tuple(x.shape) for x in maps] for maps in (student, teacher))
    if mine != theirs:
        raise TrainingError(
            f"the student's maps do not fit the teacher's: expected {name} of shapes {theirs}, got {mine}; choose "
            "another teacher, or set this term's weight to 0"
        )
