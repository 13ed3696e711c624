"""The server without a browser: who is refused, and how it ends."""

from __future__ import annotations

import http.client
import json
import signal
import subprocess
import sys
import threading
import urllib.request

import cv2
import numpy as np
import pytest
import yaml

from lcdata.dataset import build
from lcdata.dataset.picks import (
    matched_extrinsics,
    picked_extrinsics,
    picks_path,
    read_picks,
    write_picks,
)
from lcdata.errors import CalibrationError, DatasetError
from lcdata.features.point_pose import point_pose
from lcdata.geometry import se3
from lcdata.pick import PickServer, Session


def ask(server, path, *, host=None, body=None, **headers):
    connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=10)
    headers = {"Host": host or f"127.0.0.1:{server.port}", **headers}
    connection.request("POST" if body is not None else "GET", path, body, headers)
    reply = connection.getresponse()
    return reply.status, reply.read(), dict(reply.getheaders())


def test_only_its_own_page_gets_an_answer(served):
    own = f"/{served.token}/"
    status, page, headers = ask(served, own)
    assert status == 200 and b"lcdata pick" in page
    assert "default-src 'none'" in headers["Content-Security-Policy"]
    assert b"http://" not in page and b"https://" not in page  # nothing from elsewhere
    assert ask(served, own + "state")[0] == 200
    assert ask(served, "/")[0] == 404
    assert ask(served, "/guess/state")[0] == 404
    assert ask(served, own + "../../etc/passwd")[0] == 404
    assert ask(served, own, host="evil.example")[0] == 403
    assert ask(served, own, host=f"evil.example:{served.port}")[0] == 403
    assert ask(served, own + "done", body=b"{}", Origin="http://evil.example")[0] == 403
    assert ask(served, own + "solve", body=b"not json")[0] == 400
    assert ask(served, own + "nothing", body=b"{}")[0] == 404
    answer = json.loads(ask(served, own + "solve", body=b"[[1, 2, 3, 4, 5]]")[1])
    assert "1 match: give 3 or more" in answer["error"]
    assert (
        "pick where the LiDAR measured"
        in json.loads(ask(served, own + "point", body=b"[0, 0]")[1])["error"]
    )


def test_a_second_page_on_the_same_port_is_refused_in_one_line(served):
    with pytest.raises(CalibrationError, match="is in use, by another `lcdata pick`"):
        PickServer(served.session, served.port)


def matches_of(dataset, pair_id, count=8, seed=0):
    pair = dataset.load(pair_id)
    points = pair.points[np.isfinite(pair.points).all(axis=1)]
    pixels, inside = pair.camera.project(se3.apply(pair.T_camera_lidar, points))
    chosen = np.random.default_rng(seed).choice(np.flatnonzero(inside), count, replace=False)
    return np.concatenate([pixels[chosen], points[chosen]], axis=1)


def test_picks_are_kept_for_the_pair_they_were_made_on(gym):
    pair_id = gym.pairs[1].pair_id
    matches = matches_of(gym, pair_id)
    camera = gym.camera(gym.pairs[1].scenario)
    path = write_picks(gym, pair_id, matches, point_pose(matches[:, 2:], matches[:, :2], camera))
    found = picked_extrinsics(gym)
    truth = gym.pose(gym.pairs[1].pose_id).T_camera_lidar
    assert pair_id in found
    assert se3.translation_error(found[pair_id], truth) < 1e-3
    content = json.loads(path.read_text())
    path.write_text(json.dumps(content | {"cloud_sha256": "another"}))
    with pytest.raises(DatasetError, match="picked on another image or cloud"):
        read_picks(gym, pair_id)
    state = Session(gym, pair_id).state()
    assert state["matches"] == [] and "former picks are left out" in state["message"]
    path.write_text("{}")
    with pytest.raises(DatasetError, match="damaged"):
        read_picks(gym, pair_id)
    path.unlink()


def test_matches_of_a_csv(gym, tmp_path):
    pairs = [gym.pairs[0].pair_id, gym.pairs[1].pair_id]
    lines = ["pair_id, u, v, x, y, z"]
    for pair_id in pairs:
        rows = matches_of(gym, pair_id).tolist()
        lines += [", ".join([pair_id, *map(repr, row)]) for row in rows]
    path = tmp_path / "matches.csv"
    path.write_text("\n".join(lines))
    found = matched_extrinsics(gym, path)
    assert list(found) == pairs
    for pair_id, T in found.items():
        truth = gym.pose(gym.pair(pair_id).pose_id).T_camera_lidar
        assert se3.translation_error(T, truth) < 1e-3
    for text, expected in {
        "u,v,x,y": "no column z",
        "u,v,x,y,z": "has no matches",
        "u,v,x,y,z\n1,2,3,4,a": ":2: a value is no number",
        "u,v,x,y,z\n1,2,3,4,5": "add a column pair_id",
        f"pair_id,u,v,x,y,z\n{pairs[0]},1,2,3,4,5": "1 match: give 3 or more",
    }.items():
        path.write_text(text)
        with pytest.raises(CalibrationError, match=expected):
            matched_extrinsics(gym, path)


def test_a_cloud_without_intensity_is_shown_by_range(tmp_path, browser):
    """A recording without a bag, of a gray image and points on three walls."""
    run = tmp_path / "run"
    (run / "images").mkdir(parents=True), (run / "clouds").mkdir()
    rng = np.random.default_rng(0)
    walls = rng.uniform([3, -3, -3], [9, 3, 3], (4000, 3))
    walls[np.arange(4000), rng.integers(0, 3, 4000)] = 3.0
    np.save(run / "clouds" / "1700000000000000000.npy", walls.astype("f4"))
    cv2.imwrite(str(run / "images" / "1700000000.0.png"), rng.integers(0, 255, (90, 160), np.uint8))
    camera = {"width": 160, "height": 90, "intrinsics": [90, 90, 79.5, 44.5]}
    forward = [[0, -1, 0, 0], [0, 0, -1, 0], [1, 0, 0, 0], [0, 0, 0, 1]]
    rig = {"ground_truth": "static", "camera": camera, "T_camera_lidar": forward}
    (tmp_path / "rig.yaml").write_text(yaml.safe_dump(rig))
    dataset = build(run, tmp_path / "set").dataset
    session = Session(dataset, "run/pose_000/000")
    assert session.state()["has_intensity"] is False
    matches = matches_of(dataset, "run/pose_000/000")
    solved = session.solve(matches.tolist())
    np.testing.assert_allclose(solved["T_camera_lidar"], forward, atol=1e-4)

    # They are work by hand: a new build, of the same files here, leaves them alone.
    session.save(matches.tolist())
    (tmp_path / "rig.yaml").write_text(yaml.safe_dump(rig | {"note": "another"}))
    again = build(run, tmp_path / "set", force=True).dataset
    assert read_picks(again, "run/pose_000/000") is not None
    with PickServer(session) as server:
        threading.Thread(target=server.serve, daemon=True).start()
        browser.open(server.url)
        assert browser.value("shade()") == "range"
        assert browser.value("document.querySelector('[value=intensity]').disabled") is True
        assert browser.problems == []
        server.stop()


def started(gym, *options):
    command = ["-m", "lcdata", "pick", gym.path, gym.pairs[2].pair_id, "--no-browser"]
    process = subprocess.Popen(
        [sys.executable, *command, *options],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    return process, process.stderr.readline().strip()


def test_the_command_saves_and_ends_by_ctrl_c(gym):
    picks_path(gym, gym.pairs[2].pair_id).unlink(missing_ok=True)
    process, line = started(gym, "--json")
    body = json.dumps(matches_of(gym, gym.pairs[2].pair_id).tolist()).encode()
    request = urllib.request.Request(line.split()[0] + "save", body)
    with urllib.request.urlopen(request) as reply:
        assert json.load(reply)["path"].endswith(f"picks/{gym.pairs[2].pair_id}.json")
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=20)
    assert process.returncode == 0 and err == ""
    assert len(json.loads(out)["residuals_px"]) == 8


@pytest.mark.slow
def test_a_page_that_is_closed_midway_leaves_nothing(gym):
    picks_path(gym, gym.pairs[2].pair_id).unlink(missing_ok=True)
    process, line = started(gym)
    port = line.split(":")[2].split("/")[0]
    second, refused = started(gym, "--port", port)
    assert second.wait(20) == 1
    assert refused.startswith(f"lcdata: port {port} is in use") and "leave --port out" in refused
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=20)
    assert process.returncode == 1
    assert err.endswith("nothing was saved: click Save before Done\n")
    assert not picks_path(gym, gym.pairs[2].pair_id).exists()
