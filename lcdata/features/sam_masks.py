"""Masks of everything in an image by a model of the SAM family in two ONNX files.

Kirillov et al., *Segment Anything*, 2023, section 5: an encoder runs once an image, a light
decoder once a prompt; prompts are the points of a grid, and of masks that overlap much the one the
model thinks best is kept. The files have the interface of the usual exports:

    encoder: one image (1, 3, S, S) float32 -> embeddings (1, C, h, w)
    decoder: image_embeddings, point_coords (1, P, 2), point_labels (1, P), mask_input
             (1, 1, 256, 256), has_mask_input (1), orig_im_size (2)
             -> masks (1, K, H, W), above 0 inside, and iou_predictions (1, K)

The longer side of the image becomes S, the rest is padded with zeros; colours are normalised by
the mean and deviation of ImageNet.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lcdata.errors import CalibrationError
from lcdata.features.segment_layers import LEAST_AREA, reduced_camera, reduced_image
from lcdata.geometry.camera import Camera

Bytes = NDArray[np.uint8]
Floats = NDArray[np.float32]
Mask = NDArray[np.bool_]

MEAN = np.array([123.675, 116.28, 103.53], np.float32)
DEVIATION = np.array([58.395, 57.12, 57.375], np.float32)

SIDE = 1024
"""S of an encoder that takes any."""

MASK_INPUT = 256

LEAST_IOU = 0.7
"""Quality, as the model predicts it, of a mask that is kept."""

MOST_AREA = 0.9
"""Largest share of the image: more is the image itself."""

SAME_IOU = 0.7
"""Masks that overlap more are one: the better stays."""

THIN = 4
"""Every so many rows and columns are compared between masks."""

DECODER_INPUTS = (
    "image_embeddings",
    "point_coords",
    "point_labels",
    "mask_input",
    "has_mask_input",
    "orig_im_size",
)
DECODER_OUTPUTS = ("masks", "iou_predictions")


@dataclass(frozen=True, eq=False)
class Encoded:
    """An image as the decoder wants it.

    Args:
        embeddings: (1, C, h, w) float32.
        scale: Pixels of the encoder's picture a pixel of the image.
        size: (height, width) of the image, pixels.
    """

    embeddings: Floats
    scale: float
    size: tuple[int, int]


def sam_masks(image: Bytes, camera: Camera, encoder: str, decoder: str, grid: int) -> list[Bytes]:
    """Masks of an image, those that the model trusts most first.

    Args:
        image: (H, W) or (H, W, 3) uint8 RGB, as recorded.
        camera: Of the image.
        encoder: ONNX file of the encoder.
        decoder: ONNX file of the decoder.
        grid: Prompts along the longer side.

    Returns:
        (h, w) uint8 each, 255 inside, at the size of `segment_layers.reduced_camera`.

    Raises:
        CalibrationError: onnxruntime is not installed, a file is no model or not of this
            interface, or no mask is good enough.
    """
    encoding = _session(encoder, "encoder")
    decoding = _session(decoder, "decoder")
    _check_decoder(decoding, decoder)
    encoded = _encode(encoding, encoder, reduced_image(image, reduced_camera(camera)))
    packed: list[Bytes] = []  # a thousand prompts with three masks each are gigabytes else
    thin: list[Mask] = []
    scores: list[float] = []
    for point in _prompts(encoded.size, grid):
        for mask, score in _decode(decoding, decoder, encoded, point):
            if score >= LEAST_IOU and LEAST_AREA < mask.mean() < MOST_AREA:
                packed.append(np.packbits(mask))
                thin.append(mask[::THIN, ::THIN])
                scores.append(score)
    if not packed:
        raise CalibrationError(
            f"decoder {decoder}: none of the masks is good enough",
            "use a model trained for photographs, or give masks as files",
        )
    height, width = encoded.size
    return [
        255 * np.unpackbits(packed[i], count=height * width).reshape(height, width)
        for i in distinct(np.array(thin), np.array(scores))
    ]


def distinct(masks: Mask, scores: NDArray[Any], most: float = SAME_IOU) -> list[int]:
    """Non-maximum suppression: the best masks, without those much like a better one.

    Args:
        masks: (N, H, W).
        scores: (N,) the larger the better.
        most: Largest intersection over union with a better mask.

    Returns:
        Indices, best first.
    """
    areas = masks.sum(axis=(1, 2))
    kept: list[int] = []
    for i in np.argsort(-scores, kind="stable"):
        for j in kept:
            if min(areas[i], areas[j]) < most * max(areas[i], areas[j]):
                continue  # too different in size to be the same
            shared = int((masks[i] & masks[j]).sum())
            if shared > most * (areas[i] + areas[j] - shared):
                break
        else:
            kept.append(int(i))
    return kept


def _session(path: str, what: str) -> Any:
    try:
        import onnxruntime
    except ImportError as error:
        raise CalibrationError(
            f"{what} {path}: onnxruntime is not installed", "pip install 'lcdata[segment]'"
        ) from error
    if not Path(path).is_file():
        raise CalibrationError(f"{what} {path}: no such file", "give an ONNX file")
    options = onnxruntime.SessionOptions()
    options.log_severity_level = 3
    try:
        return onnxruntime.InferenceSession(path, options, providers=["CPUExecutionProvider"])
    except Exception as error:  # onnxruntime's own have no common root
        raise CalibrationError(
            f"{what} {path}: {str(error).splitlines()[0]}", "give an ONNX file of a SAM model"
        ) from error


def _check_decoder(session: Any, path: str) -> None:
    for kind, needed, nodes in (
        ("inputs", DECODER_INPUTS, session.get_inputs()),
        ("outputs", DECODER_OUTPUTS, session.get_outputs()),
    ):
        names = [node.name for node in nodes]
        missing = [name for name in needed if name not in names]
        unknown = [name for name in names if name not in needed] if kind == "inputs" else []
        if missing or unknown:
            raise CalibrationError(
                f"decoder {path}: {kind} are {', '.join(names)}",
                f"export one with {kind} {', '.join(needed)}",
            )


def _encode(session: Any, path: str, image: Bytes) -> Encoded:
    import cv2

    inputs = session.get_inputs()
    shape = list(inputs[0].shape)
    flexible = not all(isinstance(n, int) for n in shape[2:])
    whole = len(shape) == 4 and (flexible or shape[2] == shape[3])
    other = len(shape) == 4 and isinstance(shape[1], int) and shape[1] != 3
    if len(inputs) != 1 or not whole or other:
        raise CalibrationError(
            f"encoder {path}: inputs are "
            + ", ".join(f"{node.name} {tuple(node.shape)}" for node in inputs),
            "export one that takes one image (1, 3, 1024, 1024)",
        )
    side = SIDE if flexible else int(shape[2])
    height, width = image.shape[:2]
    scale = side / max(height, width)
    size = max(1, round(width * scale)), max(1, round(height * scale))
    colour = np.repeat(image[:, :, None], 3, axis=2) if image.ndim == 2 else image
    resized = cv2.resize(colour, size, interpolation=cv2.INTER_LINEAR)
    picture = np.zeros((1, 3, side, side), np.float32)
    picture[0, :, : size[1], : size[0]] = ((resized - MEAN) / DEVIATION).transpose(2, 0, 1)
    embeddings = _run(session, path, "encoder", None, {inputs[0].name: picture})[0]
    if getattr(embeddings, "ndim", 0) != 4:
        raise CalibrationError(
            f"encoder {path}: first output of shape {getattr(embeddings, 'shape', None)}",
            "export one that gives embeddings (1, C, h, w)",
        )
    return Encoded(embeddings, scale, (height, width))


def _prompts(size: tuple[int, int], grid: int) -> NDArray[np.float64]:
    """(P, 2) column and row of the middles of square cells, so many along the longer side."""
    height, width = size
    step = max(size) / grid
    columns, rows = max(1, round(width / step)), max(1, round(height / step))
    u = (np.arange(columns) + 0.5) * width / columns - 0.5
    v = (np.arange(rows) + 0.5) * height / rows - 0.5
    return np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)


def _decode(
    session: Any, path: str, encoded: Encoded, point: NDArray[np.float64]
) -> list[tuple[Mask, float]]:
    """Masks of one prompt, each with the quality that the model predicts."""
    # The second point, labelled -1, stands for the box that is not given.
    coordinates = np.array([[(point + 0.5) * encoded.scale, [0.0, 0.0]]], np.float32)
    masks, quality = _run(
        session,
        path,
        "decoder",
        list(DECODER_OUTPUTS),
        {
            "image_embeddings": encoded.embeddings,
            "point_coords": coordinates,
            "point_labels": np.array([[1, -1]], np.float32),
            "mask_input": np.zeros((1, 1, MASK_INPUT, MASK_INPUT), np.float32),
            "has_mask_input": np.zeros(1, np.float32),
            "orig_im_size": np.array(encoded.size, np.float32),
        },
    )
    if masks.ndim != 4 or masks.shape[2:] != encoded.size or quality.shape != masks.shape[:2]:
        raise CalibrationError(
            f"decoder {path}: masks of shape {masks.shape} with iou_predictions of "
            f"{quality.shape} for an image of {encoded.size[1]}x{encoded.size[0]} pixels",
            "export one whose masks have the size of orig_im_size",
        )
    return [(mask > 0, float(q)) for mask, q in zip(masks[0], quality[0], strict=True)]


def _run(
    session: Any, path: str, what: str, outputs: list[str] | None, inputs: dict[str, Any]
) -> list[Any]:
    try:
        return list(session.run(outputs, inputs))
    except Exception as error:  # onnxruntime's own have no common root
        raise CalibrationError(
            f"{what} {path}: {str(error).splitlines()[0]}",
            "export it with the inputs of the Segment Anything models",
        ) from error
