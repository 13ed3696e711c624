import sys

import numpy as np
import pytest

from lcdata.errors import CalibrationError
from lcdata.features.sam_masks import distinct, sam_masks
from lcdata.geometry.camera import Camera

pytest.importorskip("onnxruntime")
pytest.importorskip("onnx")

CAMERA = Camera("pinhole", 128, 128, (64, 64, 64, 64))


def picture():
    """Four fields of different colours, on borders of the models' cells."""
    image = np.zeros((128, 128, 3), np.uint8)
    image[:64, :64], image[:64, 64:] = (250, 10, 10), (10, 250, 10)
    image[64:, :64], image[64:, 64:] = (10, 10, 250), (250, 250, 10)
    return image


@pytest.fixture
def models(tmp_path):
    from tests.sam_models import decoder, encoder

    return encoder(tmp_path / "encoder.onnx"), decoder(tmp_path / "decoder.onnx")


def test_every_object_is_found_once(models):
    masks = sam_masks(picture(), CAMERA, *models, grid=8)
    assert len(masks) == 4
    found = {tuple(np.argwhere(mask)[0]): int((mask > 0).sum()) for mask in masks}
    assert found == dict.fromkeys([(0, 0), (0, 64), (64, 0), (64, 64)], 64 * 64)
    assert all(set(np.unique(mask)) == {0, 255} for mask in masks)


def test_grey_images_do_too(models):
    assert len(sam_masks(picture()[:, :, 0], CAMERA, *models, grid=4)) == 2


def test_a_doubtful_model_gives_a_named_error(tmp_path, models):
    from tests.sam_models import decoder

    doubtful = decoder(tmp_path / "doubtful.onnx", quality=0.2)
    with pytest.raises(CalibrationError, match="none of the masks is good enough"):
        sam_masks(picture(), CAMERA, models[0], doubtful, grid=4)


def test_other_interfaces_are_refused(tmp_path, models):
    from tests.sam_models import decoder, encoder

    other = decoder(tmp_path / "other.onnx", rename=("point_coords", "boxes"))
    with pytest.raises(CalibrationError, match=r"inputs are .*boxes.*export one with inputs"):
        sam_masks(picture(), CAMERA, models[0], other, grid=4)
    with pytest.raises(CalibrationError, match=r"decoder .*inputs are images"):
        sam_masks(picture(), CAMERA, models[0], models[0], grid=4)
    with pytest.raises(CalibrationError, match=r"encoder .*inputs are image_embeddings"):
        sam_masks(picture(), CAMERA, models[1], models[1], grid=4)
    grey = encoder(tmp_path / "grey.onnx", channels=1)
    with pytest.raises(CalibrationError, match=r"images \(1, 1, 64, 64\)"):
        sam_masks(picture(), CAMERA, grey, models[1], grid=4)
    coarse = encoder(tmp_path / "coarse.onnx", side=32)
    with pytest.raises(CalibrationError, match=r"decoder .*image_embeddings"):
        sam_masks(picture(), CAMERA, coarse, models[1], grid=4)


def test_files_that_are_no_models_are_refused(tmp_path, models):
    with pytest.raises(CalibrationError, match="no such file"):
        sam_masks(picture(), CAMERA, str(tmp_path / "none.onnx"), models[1], grid=4)
    (tmp_path / "text.onnx").write_text("no model")
    with pytest.raises(CalibrationError, match="give an ONNX file of a SAM model"):
        sam_masks(picture(), CAMERA, str(tmp_path / "text.onnx"), models[1], grid=4)


def test_without_onnxruntime_the_remedy_is_told(models, monkeypatch):
    monkeypatch.setitem(sys.modules, "onnxruntime", None)
    with pytest.raises(CalibrationError, match=r"pip install 'lcdata\[segment\]'"):
        sam_masks(picture(), CAMERA, *models, grid=4)


def test_the_better_of_two_alike_is_kept():
    masks = np.zeros((4, 10, 10), bool)
    masks[0, :5] = masks[1, :5] = masks[2, 5:] = True
    masks[1, 5, 0] = True  # nearly the first
    masks[3, :5, :2] = True  # a part of it
    assert distinct(masks, np.array([0.8, 0.9, 0.7, 0.75])) == [1, 3, 2]
