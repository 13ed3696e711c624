"""Tiny ONNX models with the interface of Segment Anything: a mask is all of the prompt's colour."""

from __future__ import annotations

import numpy as np
from onnx import TensorProto, helper, numpy_helper, save
from onnx.helper import make_node as node
from onnx.helper import make_tensor_value_info as value

SIDE, CELL = 64, 4


def _save(path, name, nodes, inputs, outputs, constants):
    tensors = [numpy_helper.from_array(np.array(v), k) for k, v in constants.items()]
    graph = helper.make_graph(nodes, name, inputs, outputs, tensors)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)])
    model.ir_version = 8
    save(model, str(path))
    return str(path)


def encoder(path, side=SIDE, channels=3):
    """Mean colours of 4 x 4 pixels."""
    picture = value("images", TensorProto.FLOAT, [1, channels, side, side])
    out = value("embeddings", TensorProto.FLOAT, [1, channels, side // CELL, side // CELL])
    pool = node("AveragePool", ["images"], ["embeddings"], kernel_shape=[4, 4], strides=[4, 4])
    return _save(path, "encoder", [pool], [picture], [out], {})


def decoder(path, quality=0.9, rename=None):
    """Where the embedding is nearly that at the first point; for square images."""
    nodes = [
        node("Gather", ["point_coords", "zero"], ["point"], axis=1),  # (1, 2)
        node("Div", ["point", "cell"], ["place"]),
        node("Floor", ["place"], ["floor"]),
        node("Cast", ["floor"], ["integer"], to=TensorProto.INT64),
        node("Gather", ["integer", "swap"], ["index"], axis=1),  # row, column
        node("Squeeze", ["image_embeddings", "axis0"], ["map"]),
        node("Transpose", ["map"], ["last"], perm=[1, 2, 0]),
        node("GatherND", ["last", "index"], ["colour"]),
        node("Reshape", ["colour", "shape"], ["wanted"]),
        node("Sub", ["image_embeddings", "wanted"], ["difference"]),
        node("Abs", ["difference"], ["size"]),
        node("ReduceSum", ["size", "axis1"], ["distance"], keepdims=1),
        node("Sub", ["near", "distance"], ["logits"]),
        node("Cast", ["orig_im_size"], ["pixels"], to=TensorProto.INT64),
        node("Concat", ["ones", "pixels"], ["sizes"], axis=0),
        node("Resize", ["logits", "", "", "sizes"], ["masks"], mode="nearest"),
        node("Identity", ["quality"], ["iou_predictions"]),
    ]
    F = TensorProto.FLOAT
    inputs = [
        value("image_embeddings", F, [1, 3, SIDE // CELL, SIDE // CELL]),
        value("point_coords", F, [1, "points", 2]),
        value("point_labels", F, [1, "points"]),
        value("mask_input", F, [1, 1, 256, 256]),
        value("has_mask_input", F, [1]),
        value("orig_im_size", F, [2]),
    ]
    outputs = [value("masks", F, [1, 1, "h", "w"]), value("iou_predictions", F, [1, 1])]
    constants = {
        "zero": np.int64(0),
        "cell": np.float32(CELL),
        "swap": np.array([1, 0], np.int64),
        "axis0": np.array([0], np.int64),
        "axis1": np.array([1], np.int64),
        "shape": np.array([1, 3, 1, 1], np.int64),
        "near": np.float32(0.3),
        "ones": np.array([1, 1], np.int64),
        "quality": np.array([[quality]], np.float32),
    }
    if rename:
        old, new = rename
        for proto in inputs:
            if proto.name == old:
                proto.name = new
        for proto in nodes:
            proto.input[:] = [new if name == old else name for name in proto.input]
    return _save(path, "decoder", nodes, inputs, outputs, constants)
