"""What a user types wrongly, and the one line that answers."""

from __future__ import annotations

import pytest

COMMANDS = ["build", "info", "simulate", "calibrate", "report", "review", "validate"]


def assert_one_line(done, *words: str, code: int = 1) -> None:
    assert done.returncode == code, done.stderr
    assert done.stderr.startswith("lcdata: ")
    assert done.stderr.count("\n") == 1
    assert "Traceback" not in done.stderr
    for word in words:
        assert word in done.stderr


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_has_help_with_an_example_and_json(lcdata, command):
    done = lcdata(command, "--help")
    assert done.returncode == 0
    assert f"Example:  lcdata {command}" in done.stdout
    assert "--json" in done.stdout


def test_wrong_usage_exits_with_two(lcdata):
    assert lcdata("bild").returncode == 2
    assert lcdata("build").returncode == 2
    assert lcdata("build", "x", "--trials", "0").returncode == 2
    assert lcdata("build", "x", "--jbos", "2").returncode == 2


def test_version(lcdata):
    import lcdata as package

    assert lcdata("--version").stdout.strip() == f"lcdata {package.__version__}"


def test_a_path_that_is_not_there(lcdata, tmp_path):
    for command in ("build", "info"):
        assert_one_line(lcdata(command, tmp_path / "no.bag", cwd=tmp_path), "no.bag")
    for command in ("calibrate", "report", "review", "validate"):
        assert_one_line(lcdata(command, tmp_path / "none", cwd=tmp_path), "none")
    assert not (tmp_path / "dataset").exists()


def test_an_unknown_method_is_told_before_anything_is_read(lcdata, tmp_path):
    done = lcdata("build", tmp_path, "--methods", "projektion", cwd=tmp_path)
    assert_one_line(done, "projektion", "did you mean 'projection'")


def test_a_zero_length_recording(lcdata, tmp_path):
    (tmp_path / "empty.bag").touch()
    (tmp_path / "rig.yaml").write_text("ground_truth: static")
    out = tmp_path / "out"
    assert_one_line(lcdata("build", tmp_path / "empty.bag", "-o", out), "empty.bag")
    assert not out.exists()
    assert_one_line(lcdata("info", tmp_path / "empty.bag"), "empty.bag")


def test_a_folder_without_recordings(lcdata, tmp_path):
    assert_one_line(lcdata("build", tmp_path, cwd=tmp_path), str(tmp_path))


def test_debug_shows_the_traceback(lcdata, tmp_path):
    done = lcdata("info", tmp_path / "no.bag", "--debug")
    assert done.returncode == 1
    assert "Traceback" in done.stderr


def test_an_unknown_scenario_names_the_known_ones(lcdata, tmp_path):
    done = lcdata("simulate", tmp_path / "out", "--scenario", "garden")
    assert_one_line(done, "garden", "gym", "yard", "parking_lot")
