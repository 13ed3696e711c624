"""The page in a real browser: clicks in, an extrinsic out."""

from __future__ import annotations

import json

import cv2
import numpy as np
import pytest

from lcdata.dataset.picks import read_picks
from lcdata.geometry import se3

SPOT = (
    "(() => {{ const box = {0}.canvas.getBoundingClientRect(), at = {0}.toScreen({1});"
    "return [box.left + at[0], box.top + at[1]]; }})()"
)
CTRL = 2


@pytest.fixture
def places(served):
    """Matches as a careful person sees them: pixels of the image and of the LiDAR's picture."""
    pair = served.session.dataset.load(served.session.pair_id)
    view = served.session._view
    rows = np.unique(view.index[view.measured])
    points = np.asarray(pair.points, float)[rows]
    pixels, inside = pair.camera.project(se3.apply(pair.T_camera_lidar, points))
    chosen = np.random.default_rng(3).choice(np.flatnonzero(inside), 9, replace=False)
    seen = view.camera.project(points[chosen] @ view.R_view_lidar.T)[0]
    return pixels[chosen].tolist(), seen.tolist(), pair.T_camera_lidar


def click(browser, side, place):
    browser.click(*browser.value(SPOT.format(side, json.dumps(place))))


def match(browser, places, i):
    click(browser, "camera", places[0][i])
    click(browser, "lidar", places[1][i])
    browser.until(f"whole().length === {i + 1} && $('undo').disabled === false")


def solved(browser, count):
    """The page's extrinsic, once it is of so many matches and may be saved."""
    browser.until(f"whole().length === {count} && $('save').disabled !== unsaved")
    browser.until(f"solved && solved.residuals_px && solved.residuals_px.length === {count}")
    return np.array(browser.value("solved.T_camera_lidar"))


def test_matches_are_clicked_judged_undone_and_saved(browser, served, places, tmp_path):
    browser.open(served.url)
    assert browser.value("document.title").startswith(served.session.pair_id)
    assert browser.value("$('save').disabled") is True
    for i in range(6):
        match(browser, places, i)
    T = solved(browser, 6)
    # A screen pixel is two of the image's here: clicks are rounded.
    assert se3.rotation_error(T, places[2]) < np.deg2rad(1.5)
    assert se3.translation_error(T, places[2]) < 0.3
    assert "<b>6</b> matches" in browser.value("$('verdict').innerHTML")

    # The projection appears, follows the slider, and is what the pose says.
    def picture(blend):
        browser.value(f"$('blend').value = {blend}; $('blend').oninput(); 1")
        browser.picture(tmp_path / "page.png")
        return cv2.imread(str(tmp_path / "page.png")).astype(int)

    image, mixed, cloud = picture(0), picture(50), picture(100)
    assert np.abs(mixed - image).mean() > 2 and np.abs(cloud - mixed).mean() > 2

    # Half a match waits for its other half; undo takes one click back at a time.
    click(browser, "camera", places[0][6])
    browser.until("document.querySelectorAll('.picks li.open').length === 1")
    browser.until("$('hint').textContent.includes('click the same place in the LiDAR image')")
    browser.key("z", CTRL)
    browser.until("matches.length === 6")
    browser.key("z", CTRL)
    browser.until("whole().length === 5 && matches.length === 6")
    click(browser, "lidar", places[1][5])
    solved(browser, 6)

    browser.key("s", CTRL)
    browser.until("$('hint').className.includes('good')")
    picks = read_picks(served.session.dataset, served.session.pair_id)
    assert picks is not None and len(picks.matches) == 6
    np.testing.assert_allclose(picks.T_camera_lidar, browser.value("solved.T_camera_lidar"))
    assert browser.value("$('save').disabled") is True

    # A page opened anew starts from what was saved.
    browser.open(served.url)
    assert browser.value("whole().length") == 6
    np.testing.assert_allclose(solved(browser, 6), picks.T_camera_lidar, atol=1e-5)
    assert browser.problems == []


def test_a_mark_is_dragged_and_a_wrong_match_is_named_and_removed(browser, served, places):
    browser.open(served.url)
    for i in range(7):
        match(browser, places, i)
    good = solved(browser, 7)
    start = browser.value(SPOT.format("camera", json.dumps(places[0][2])))
    browser.drag(start, (start[0] + 90, start[1] + 60))
    browser.until("$('hint').textContent.includes('match 3 is')")
    assert browser.value("document.querySelectorAll('.picks li.far').length") == 1
    browser.value("document.querySelectorAll('.picks li button')[2].click(); 1")
    solved(browser, 6)
    browser.key("z", CTRL)
    browser.key("z", CTRL)
    again = solved(browser, 7)
    np.testing.assert_allclose(again, good, atol=1e-9)
    assert browser.problems == []
    browser.value("unsaved = false; 1")


def test_three_matches_and_swapped_sides_are_told(browser, served, places):
    browser.open(served.url)
    for i in range(3):
        match(browser, places, i)
    browser.until("$('hint').textContent.includes('pick one more')")
    # The same clicks on a picture whose left and right are swapped.
    given = [
        [*pixel, *served.session.point(*seen)["point"]]
        for pixel, seen in zip(places[0][:8], places[1][:8], strict=True)
    ]
    mirrored = [[u, v, x, -y, z] for u, v, x, y, z in given]
    answer = browser.value(f"post('solve', {json.dumps(mirrored)})")
    assert "mirrored scene: left and right are swapped" in answer["error"]
    browser.value("unsaved = false; 1")


def test_zoom_keeps_the_place_under_the_cursor_and_fit_brings_all_back(browser, served):
    browser.open(served.url)
    box = browser.value("(({left, top}) => [left, top])(lidar.canvas.getBoundingClientRect())")
    before = (1000, 400)
    under = f"lidar.toPicture([1000 - {box[0]}, 400 - {box[1]}])"
    place = browser.value(under)
    for _ in range(6):
        browser.mouse("mouseWheel", *before, deltaX=0, deltaY=-200)
    browser.until("lidar.touched === true")
    np.testing.assert_allclose(browser.value(under), place, atol=0.1)
    assert browser.value("lidar.place.scale") > 3
    browser.drag(before, (before[0] + 40, before[1] + 10))
    moved = browser.value(SPOT.format("lidar", json.dumps(place)))
    np.testing.assert_allclose(np.subtract(moved, before), [40, 10], atol=0.1)
    assert browser.value("matches.length") == 0
    browser.key("f")
    assert browser.value("lidar.touched") is False
    # Sky, where no point is, gives no match.
    browser.click(box[0] + 360, box[1] + 60)
    browser.until("$('hint').textContent.includes('no point there')")
    assert browser.value("matches.length") == 0


def test_both_themes_and_a_panorama_above_the_image(browser, served, tmp_path):
    paper = {}
    for theme in ("light", "dark"):
        browser.theme(theme)
        browser.open(served.url)
        browser.picture(tmp_path / f"{theme}.png")
        paper[theme] = cv2.imread(str(tmp_path / f"{theme}.png"))[5, 700].mean()
    assert paper["light"] > 230 and paper["dark"] < 60
    assert browser.value("document.body.className") == ""
    browser.value("lidar.shown = [0, 400, 2048, 600]; camera.shown = [0, 0, 1280, 400]; arrange()")
    assert browser.value("document.body.className") == "stacked"


def test_done_ends_the_server_and_says_so(browser, served):
    browser.open(served.url)
    browser.value("$('done').click(); 1")
    browser.until("document.body.className.includes('ended')")
    assert "You can close this page" in browser.value("$('over').textContent")
