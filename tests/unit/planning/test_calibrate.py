# SPDX-License-Identifier: Apache-2.0
"""Measuring the machine once, and knowing when that no longer holds."""

import pytest

from cotton3dg.planning import calibrate
from cotton3dg.planning.cost import Machine


@pytest.fixture(autouse=True)
def cache(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(calibrate, "SPLATTING_TIMES", 1)
    monkeypatch.setattr(calibrate, "IMAGING_TIMES", 1)
    return tmp_path / "cotton3dg" / "calibration.json"


def test_it_is_measured_once_and_kept(cache):
    said = []
    assert calibrate.read_calibration() is None
    first = calibrate.read_or_calibrate(said.append)
    assert cache.is_file() and len(said) == 1
    assert 0 < first.splatting < 100 and 0 < first.imaging < 100
    assert 1 <= first.cores <= len(calibrate.usable_cores())
    assert calibrate.read_or_calibrate(said.append) == first and len(said) == 1
    assert "reference machine" in calibrate.describe(first)


@pytest.mark.parametrize("text", ["", "{", "[]", "{}", '{"of": {}, "machine": {}}'])
def test_a_damaged_file_counts_as_none(cache, text):
    cache.parent.mkdir()
    cache.write_text(text)
    assert calibrate.read_calibration() is None


def test_another_number_of_cores_is_another_machine(cache, monkeypatch):
    calibrate.calibrate()
    assert isinstance(calibrate.read_calibration(), Machine)
    monkeypatch.setattr(calibrate, "usable_cores", lambda: list(range(99)))
    assert calibrate.read_calibration() is None


@pytest.mark.parametrize("home", ["/proc/nowhere", "/dev/null", None])
def test_without_a_home_to_keep_it_in_it_is_measured_each_time(monkeypatch, home):
    def homeless():
        raise RuntimeError("Could not determine home directory.")

    if home is None:
        monkeypatch.delenv("XDG_CACHE_HOME")
        monkeypatch.setattr(calibrate.Path, "home", homeless)
    else:
        monkeypatch.setenv("XDG_CACHE_HOME", home)
    said = []
    for number in (1, 2):
        assert isinstance(calibrate.read_or_calibrate(said.append), Machine)
        assert len(said) == number
