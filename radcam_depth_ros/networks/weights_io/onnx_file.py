"""Reads ONNX files of `radcam-depth export`: all is checked before onnxruntime gets what was checked.

A file is a serialised model, and behind it its SHA-256 as one more entry of the model's metadata: protobuf reads
messages that follow one another as one, so that the whole is an ONNX file for every reader.
"""

from __future__ import annotations

import hashlib
import importlib.util
import re
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from torch import nn

from radcam_depth_ros.extras import install_extra
from radcam_depth_ros.networks.interface import RADAR_COLUMNS, Depths
from radcam_depth_ros.networks.weights_io.card import Archive, ArchiveError, read_card
from radcam_depth_ros.networks.weights_io.export_check import LARGEST_CARD_BYTES
from radcam_depth_ros.networks.weights_io.operators import ONNX_OPERATORS

if TYPE_CHECKING:
    import onnx

CARD_KEY, DIGEST_KEY = "card", "sha256"
INPUTS = ("image", "radar", "ground")
MULTIPLE = 32
"""Heights and widths are multiples of it, as all networks need them."""

_SEAL = re.compile(rb"\x72\x4a\x0a\x06" + DIGEST_KEY.encode() + rb"\x12\x40([0-9a-f]{64})")
"""The metadata entry with the SHA-256 of all that is before it."""
_SEAL_BYTES = 76
_ANEW = "make one with `radcam-depth export`"


class OnnxNetwork(nn.Module):
    """A network of an ONNX file: onnxruntime runs it (`engine.onnx_calls`), and torch cannot.

    Args:
        content: The model as it was checked, serialised.
        height: Rows of the image that it takes.
        width: Columns of that image.
        outputs: Names of what it gives, fields of `Depths`.
    """

    def __init__(self, content: bytes, height: int, width: int, outputs: tuple[str, ...]) -> None:
        super().__init__()
        self.content = content
        self.height = height
        self.width = width
        self.outputs = outputs

    def forward(self, *_: Any) -> NoReturn:
        """Refuses to run, by an ArchiveError."""
        raise ArchiveError("expected weights that torch can run, got an ONNX file; give the .safetensors file")


class _RefusedError(Exception):
    """Why an ONNX file is not to be read."""


def require(what: str, *packages: str) -> None:
    """Refuses where packages are not installed, by an ArchiveError that says which extra brings them."""
    missing = next((package for package in packages if importlib.util.find_spec(package) is None), None)
    if missing is not None:
        raise ArchiveError(
            f"{what} needs the package {missing}, which is not installed; use the .safetensors file, or "
            f"{install_extra('onnx')}"
        )


def seal(content: bytes) -> bytes:
    """A serialised model with its SHA-256 behind it."""
    digest = hashlib.sha256(content).hexdigest().encode()
    return content + b"\x72\x4a\x0a\x06" + DIGEST_KEY.encode() + b"\x12\x40" + digest


def load(path: Path, content: bytes) -> Archive:
    """Makes a network of an ONNX file's bytes; ArchiveError, which names the path, where it is none or not safe."""
    require(f"{path}, an ONNX file,", "onnx", "onnxruntime")
    seal_found = _SEAL.fullmatch(content[-_SEAL_BYTES:])
    if seal_found and hashlib.sha256(content[:-_SEAL_BYTES]).hexdigest().encode() != seal_found.group(1):
        raise ArchiveError(
            f"{path} is not the file that was exported (its SHA-256 differs): it is corrupt or was changed; copy it "
            "again, or make it anew with `radcam-depth export`"
        )
    model = _parsed(path, content)
    texts = {entry.key: entry.value for entry in model.metadata_props}
    if CARD_KEY not in texts:
        raise ArchiveError(f"{path} is an ONNX file of another model: it has no card of this package; {_ANEW}")
    if not seal_found:
        raise ArchiveError(f"{path} does not end with its SHA-256: it was changed or cut; copy it again, or {_ANEW}")
    if len(texts[CARD_KEY]) > LARGEST_CARD_BYTES:
        raise ArchiveError(
            f"expected a card of at most {LARGEST_CARD_BYTES} bytes in {path}, got {len(texts[CARD_KEY])}; {_ANEW}"
        )
    card = read_card(texts[CARD_KEY], str(path))
    try:
        network = _checked(model)
    except _RefusedError as refusal:
        raise ArchiveError(f"{path} is not read: {refusal}; {_ANEW}") from None
    if card.tells_classes != ("classes" in network.outputs):
        raise ArchiveError(f"{path} contradicts its card: its outputs are {', '.join(network.outputs)}; {_ANEW}")
    return Archive(network, card)


def open_session(network: OnnxNetwork, providers: list[Any], threads: int) -> Any:
    """An `onnxruntime.InferenceSession` of a checked file; its errors are onnxruntime's own."""
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads, options.inter_op_num_threads = threads, 1
    options.log_severity_level = 3  # errors: what is only slower is for those who tune
    return onnxruntime.InferenceSession(network.content, options, providers=providers)


def _parsed(path: Path, content: bytes) -> onnx.ModelProto:
    import onnx

    try:
        model = onnx.load_model_from_string(content)
    except Exception as error:  # protobuf's exceptions have no base of their own
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise ArchiveError(f"{path} is no ONNX file that can be read ({reason}); {_ANEW}") from None
    # What this parser does not know, another one may: onnxruntime must see no more than was checked.
    model.DiscardUnknownFields()
    return model


def _checked(model: onnx.ModelProto) -> OnnxNetwork:
    """The network of a model that computes and does nothing else; _RefusedError for any other."""
    import onnx

    domains = sorted({entry.domain for entry in model.opset_import})
    if domains != [""] or model.functions or model.training_info or len(model.opset_import) != 1:
        raise _RefusedError(
            "it has operators of its own, or parts for training, which exports of this package do not have"
        )
    for node in model.graph.node:
        if node.domain or node.op_type not in ONNX_OPERATORS:
            name = f"{node.domain}:{node.op_type}"[:80]
            raise _RefusedError(f"it has the operator {name!r}, which exports of this package do not have")
        for attribute in node.attribute:
            if attribute.HasField("g") or attribute.graphs or attribute.ref_attr_name:
                raise _RefusedError(f"its operator {node.op_type!r} has a graph of its own")
    for tensor in _tensors(model):
        if tensor.data_location == onnx.TensorProto.EXTERNAL or tensor.external_data:
            raise _RefusedError("one of its tensors is in another file, and all must be inside")
    if {entry.key for entry in model.metadata_props} != {CARD_KEY, DIGEST_KEY} or len(model.metadata_props) != 2:
        # onnxruntime can take settings of its own from there.
        raise _RefusedError("its metadata has more than its card and its SHA-256")
    if model.graph.sparse_initializer:
        raise _RefusedError("it has sparse tensors, which exports of this package do not have")
    height, width = _image_size(model.graph)
    outputs = tuple(value.name for value in model.graph.output)
    if outputs[:3] != Depths._fields[:3] or outputs[3:] != tuple(n for n in Depths._fields[3:] if n in outputs[3:]):
        raise _RefusedError(f"its outputs are {', '.join(outputs)[:200]!r} in place of {', '.join(Depths._fields)}")
    try:
        onnx.checker.check_model(model)
    except onnx.checker.ValidationError as error:
        raise _RefusedError(f"it is no valid model: {str(error).splitlines()[0][:200]}") from None
    return OnnxNetwork(model.SerializeToString(), height, width, outputs)


def _tensors(model: onnx.ModelProto) -> Iterator[onnx.TensorProto]:
    yield from model.graph.initializer
    for node in model.graph.node:
        for attribute in node.attribute:
            yield attribute.t
            yield from attribute.tensors
            yield attribute.sparse_tensor.values
            for sparse in attribute.sparse_tensors:
                yield sparse.values


def _image_size(graph: onnx.GraphProto) -> tuple[int, int]:
    """Height and width of the image that a graph takes; _RefusedError where its inputs are not those of an export."""
    import onnx

    kinds = (onnx.TensorProto.UINT8, onnx.TensorProto.FLOAT, onnx.TensorProto.FLOAT)
    given = [(value.name, value.type.tensor_type) for value in graph.input]
    if tuple(name for name, _ in given) != INPUTS or tuple(kind.elem_type for _, kind in given) != kinds:
        names = ", ".join(name for name, _ in given)
        raise _RefusedError(f"its inputs are {names[:200]!r} in place of {', '.join(INPUTS)}")
    shapes = [[0 if dim.dim_param else dim.dim_value for dim in kind.shape.dim] for _, kind in given]
    image = shapes[0]
    sides = len(image) == 3 and all(side > 0 and side % MULTIPLE == 0 for side in image[:2])
    if not sides or image[2] != 3 or shapes[1:] != [[0, len(RADAR_COLUMNS)], [4]]:
        raise _RefusedError(f"its inputs have the shapes {shapes} in place of [height, width, 3], [0, 6] and [4]")
    return image[0], image[1]
