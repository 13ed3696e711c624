from __future__ import annotations

import numpy as np
import pytest

from lcdata.recording.merging import merge_scans
from lcdata.recording.pairing import pair_stamps

MS = 1_000_000


def runs_of(scans_ms, images_ms, max_scans, *, moving):
    scans = np.array(scans_ms) * MS
    images = np.array(images_ms) * MS
    pairing = pair_stamps(scans, images, 50 * MS)
    merged, runs = merge_scans(scans, pairing, max_scans, moving=moving)
    found = [
        (int(scans[s]) // MS, int(images[i]) // MS, (run // MS).tolist())
        for s, i, run in zip(merged.lidar, merged.image, runs, strict=True)
    ]
    assert [(i - s) * MS for s, i, _ in found] == merged.dt_ns.tolist()
    return found


def test_a_lidar_that_stands_still_merges_all_scans_with_the_nearest_image():
    found = runs_of(range(0, 1000, 100), [30, 210, 440, 599, 970], 100, moving=False)
    assert found == [(600, 599, list(range(0, 1000, 100)))]


def test_long_dwells_make_several_clouds_and_the_short_rest_is_left():
    found = runs_of(range(0, 1000, 100), range(0, 1000, 100), 4, moving=False)
    assert [run for _, _, run in found] == [[0, 100, 200, 300], [400, 500, 600, 700], [800, 900]]
    found = runs_of(range(0, 900, 100), range(0, 900, 100), 4, moving=False)
    assert len(found) == 2
    found = runs_of(range(0, 200, 100), range(0, 200, 100), 100, moving=False)
    assert [run for _, _, run in found] == [[0, 100]]


def test_a_moving_lidar_merges_from_the_scan_of_the_image_on():
    found = runs_of(range(0, 1000, 100), [310, 820], 4, moving=True)
    assert found == [(300, 310, [300, 400, 500, 600]), (800, 820, [800, 900])]


@pytest.mark.parametrize("moving", [False, True])
def test_without_an_image_there_is_no_run(moving):
    assert runs_of(range(0, 1000, 100), [5000], 4, moving=moving) == []
    assert runs_of([], [10], 4, moving=moving) == []
