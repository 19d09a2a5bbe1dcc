"""Defines the inputs and outputs of every network.

A network is called as `network(image, radar, valid, ground) -> Depths`:

- image (B, 3, H, W) float, 0 to 1; H and W are multiples of 32.
- radar (B, N, 6) float, columns of `RADAR_COLUMNS`; N may be 0. NaN where a sensor does not give a value.
- valid (B, N) bool: rows that are returns; the others are padding.
- ground (B, 4) float: a, b, c of the flat road's inverse depth a u + b v + c in 1 / m, and 1 where it is known, 0 where
  it is assumed; a, b, c are NaN where nothing is assumed either.

Depth is metres along the camera's z axis. Drawing radar into image planes happens inside, so that a network needs
nothing but its archive.
"""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, ClassVar, NamedTuple

import torch
from torch import Tensor, nn

RADAR_COLUMNS = ("u_px", "v_px", "depth_m", "rcs_dbsm", "radial_speed_mps", "age_s")
"""Columns of the radar input; u and v are pixels of the image that the network is given."""


class Depths(NamedTuple):
    """What every network returns; each (B, 1, H, W), float32 but for `classes`, the sky of that size or half of it.

    dense: metres within the network's depth range, everywhere.
    semi_dense: metres where a radar return was associated, NaN elsewhere.
    confidence: probability that `dense` is within 10 % of the true depth; what else it may be its network tells.
    classes: what a pixel shows, uint8, the training ids of Cityscapes (`classes.CLASS_NAMES`); None of a network that
        does not tell.
    sky: probability that a pixel shows the sky; None of a network that does not tell.
    """

    dense: Tensor
    semi_dense: Tensor
    confidence: Tensor
    classes: Tensor | None = None
    sky: Tensor | None = None


class Association(NamedTuple):
    """Which pixels belong to which radar return, as training needs it.

    logits: (B, M, h, w), of the probability that a pixel belongs to a return; M returns for each pixel, or column.
    depth_m: The depths of these returns, broadcast to the shape of `logits`; NaN where a logit is not trained.
    columns: (B, M, w) int64, the column of each logit in an image of h rows, -1 where it is not trained; None where
        that is its own column.
    """

    logits: Tensor
    depth_m: Tensor
    columns: Tensor | None


class Candidates(NamedTuple):
    """The depths between which a network chooses for each pixel, at the image's size or smaller by a whole factor.

    logits: (B, K, h, w).
    depth_m: (B, K, h, w) metres.
    """

    logits: Tensor
    depth_m: Tensor


class TrainOutputs(NamedTuple):
    """What training needs of `baff`: the depths, and what its other losses are made from.

    `road_m` is the depth of the road as the network corrected it, (B, 1, h, w) with the image's size or smaller by a
    whole factor; `told_m` is that of the road as it was told or assumed, and `road_deviation` the standard deviation of
    the logarithm of `road_m`, both of the same size. `heard` is how much of its correction was made, (B, 1), 0 to 1.

    `own_m` and `geometry_m` are the network's own depth and geometry's, between which the dense depth lies, and
    `sky_logit` is the logit of the sky, all (B, 1, h, w) likewise.

    `group_logits` are those of the groups of classes, (B, groups, h, w) likewise.

    Parts of a network whose weights are fixed (`requires_grad` is False) give None: what does not learn has no loss.
    """

    depths: Depths | None
    confidence_logit: Tensor | None
    association: Association | None
    candidates: Candidates | None
    road_m: Tensor | None
    own_m: Tensor | None = None
    geometry_m: Tensor | None = None
    sky_logit: Tensor | None = None
    told_m: Tensor | None = None
    road_deviation: Tensor | None = None
    heard: Tensor | None = None
    group_logits: Tensor | None = None


class Network(nn.Module):
    """Base of the networks in the registry.

    Attributes:
        about: What it is and where it was published, in a line.
        config_type: The frozen dataclass of the architecture.
        config: Its instance: architecture only, no loss weights, paths or devices.
        parts: Names of the submodules that can be trained one by one.
        sections: What `radcam-depth bench` measures by itself, in order: a name to show, and the path of a submodule
            that a forward pass calls exactly once ("fusion.image_encoder"); none lies within another. Submodules of
            one name are one section together; paths that an architecture lacks, or has an `Identity` at, are left out.
        backbones: Names of the submodules that take the weights of public checkpoints.
        adjustable: Names of the config's values that no weight depends on: they may be changed after training.
        trained_like: Name of the network whose losses and recipe it is trained by; empty for its own.
        grows: Names of the config's values that add submodules, which weights without them can be trained on from, and
            what each is without.
        paper: Values of the config that make it the form of its paper, the reference of `radcam-depth bench`.
        paper_network: Name of the network that is this form, with the values of `paper`; empty for the network itself.
    """

    about: ClassVar[str] = ""
    config_type: ClassVar[type[Any]]
    parts: ClassVar[tuple[str, ...]] = ()
    sections: ClassVar[tuple[tuple[str, str], ...]] = ()
    backbones: ClassVar[tuple[str, ...]] = ()
    adjustable: ClassVar[tuple[str, ...]] = ()
    trained_like: ClassVar[str] = ""
    grows: ClassVar[Mapping[str, Any]] = MappingProxyType({})
    paper: ClassVar[Mapping[str, Any]] = MappingProxyType({})
    paper_network: ClassVar[str] = ""

    @classmethod
    def tells_classes(cls, config: Any) -> bool:
        """Whether a network of this config gives `Depths.classes`."""
        del config
        return False

    def __init__(self, config: Any) -> None:
        super().__init__()
        self.config = config

    @torch.jit.unused
    def train_outputs(self, image: Tensor, radar: Tensor, valid: Tensor, ground: Tensor) -> Any:
        """A NamedTuple of the network's own, with what its losses need; arguments as in `forward`."""
        raise TypeError(f"{type(self).__name__} cannot be trained: it does not define train_outputs")


class SinglePass(Network):
    """A network whose training outputs come from the forward pass as it is; they have the field `depths`."""

    def forward(self, image: Tensor, radar: Tensor, valid: Tensor, ground: Tensor) -> Depths:
        depths: Depths = self.outputs(image, radar, valid, ground).depths
        return depths

    @torch.jit.unused
    def train_outputs(self, image: Tensor, radar: Tensor, valid: Tensor, ground: Tensor) -> Any:
        """The forward pass with what the losses need."""
        return self.outputs(image, radar, valid, ground)

    def outputs(self, image: Tensor, radar: Tensor, valid: Tensor, ground: Tensor) -> Any:
        """A NamedTuple of the network's own; arguments as in `forward`."""
        raise TypeError(f"{type(self).__name__} does not define outputs")


def learns(module: nn.Module) -> bool:
    """Whether any of a module's weights is trained."""
    return any(parameter.requires_grad for parameter in module.parameters())
