"""What the code of an exported file may do: operators of torch that compute, and nothing else."""

OPERATORS = frozenset(
    """
    __and__ __getitem__ __not__ __or__ __xor__ abs abs_ adaptive_avg_pool2d add add_ addcmul addcmul_ addmm
    all amax amin any append arange argmax argmin argsort avg_pool2d baddbmm batch_norm bitwise_and
    bitwise_not bitwise_or bmm cat ceil chunk clamp clamp_ clamp_max clamp_min clone constant_pad_nd
    contiguous conv1d conv2d conv3d conv_transpose2d cos cumsum detach diag_embed diagonal dim div div_
    dropout einsum elu elu_ empty_like eq exp exp_ expand expand_as expm1 eye flatten flip floor floor_
    floor_divide floordiv format full full_like gather ge gelu group_norm gt hardsigmoid hardswish hardtanh
    hardtanh_ index index_select insert instance_norm interpolate is_floating_point is_grad_enabled isfinite
    isinf isnan layer_norm le leaky_relu leaky_relu_ len lerp linalg_cross linear linspace list log log1p log2
    log_softmax logical_and logical_not logical_or logsumexp lt masked_fill masked_fill_ matmul max max_pool2d
    maximum mean min minimum mish mm movedim mul mul_ nan_to_num narrow ne neg new_full new_ones new_zeros
    norm numel ones ones_like pad permute pixel_shuffle pixel_unshuffle pow prod reciprocal reflection_pad2d
    relu relu6 relu6_ relu_ remainder repeat repeat_interleave replication_pad2d reshape roll round rsqrt rsub
    scaled_dot_product_attention scatter scatter_ scatter_add scatter_add_ scatter_reduce select sigmoid
    sigmoid_ sign silu silu_ sin size slice softmax softplus sort split sqrt square squeeze stack std sub sub_
    sum t tan tanh tanh_ to topk transpose tril triu type_as unbind unflatten unsqueeze upsample_bicubic2d
    upsample_bilinear2d upsample_nearest1d upsample_nearest2d upsample_nearest3d var view where zeros
    zeros_like
    """.split()  # noqa: SIM905  # one line for each would be three pages
)
"""Functions of `torch`; none of them reads or writes anything but its arguments."""

PRIMITIVES = frozenset(
    """
    Constant If ListConstruct ListUnpack Loop NumToTensor RaiseException TupleConstruct TupleIndex TupleUnpack
    Uninitialized device dtype max min unchecked_cast
    """.split()  # noqa: SIM905  # as above
)
"""Building blocks of TorchScript (`prim`)."""

BUILT_INS = frozenset(("annotate", "float", "int", "bool", "isinstance", "range", "unchecked_cast", "uninitialized"))
"""Functions without a module's name in the code of TorchScript."""

ONNX_OPERATORS = frozenset(
    """
    Abs Add And ArgMax ArgMin AveragePool BatchNormalization Cast CastLike Ceil Clip Concat Constant ConstantOfShape
    Conv ConvTranspose Cos CumSum DepthToSpace Div Einsum Elu Equal Erf Exp Expand EyeLike Flatten Floor Gather
    GatherElements GatherND Gelu Gemm GlobalAveragePool GlobalMaxPool Greater GreaterOrEqual GroupNormalization
    HardSigmoid HardSwish Identity InstanceNormalization IsInf IsNaN LayerNormalization LeakyRelu Less LessOrEqual Log
    LogSoftmax MatMul Max MaxPool Mean Min Mish Mod Mul Neg NonZero Not OneHot Or PRelu Pad Pow Range Reciprocal
    ReduceL1 ReduceL2 ReduceLogSum ReduceLogSumExp ReduceMax ReduceMean ReduceMin ReduceProd ReduceSum ReduceSumSquare
    Relu Reshape Resize Round ScatterElements ScatterND Selu Shape Sigmoid Sign Sin Size Slice Softmax Softplus
    SpaceToDepth Split Sqrt Squeeze Sub Sum Tan Tanh Tile TopK Transpose Trilu Unsqueeze Where Xor
    """.split()  # noqa: SIM905  # as above
)
"""Operators of ONNX (domain ai.onnx) that compute on tensors: no loops, no branches, no text, no random numbers."""
