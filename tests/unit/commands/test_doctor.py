# SPDX-License-Identifier: Apache-2.0
import json
import subprocess
import sys
import zipfile
from importlib import metadata

import pytest

from cotton3dg.commands import doctor
from cotton3dg.errors import MissingInput

DOCTOR = (sys.executable, "-m", "cotton3dg.cli", "doctor")


@pytest.fixture(scope="module")
def told(tmp_path_factory):
    """What the command says of this machine, by name."""
    command = [*DOCTOR, str(tmp_path_factory.mktemp("place")), "--json"]
    found = json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout)
    assert {"name", "found", "remedy", "fatal"} == found[0].keys()
    return {item["name"]: doctor.Finding(**item) for item in found}


def test_this_machine_is_usable_and_every_dependency_is_looked_at(told):
    findings = told
    assert [f for f in findings.values() if f.fatal and f.remedy] == []
    assert len({"open3d", "open3d-cpu"} & findings.keys()) == 1  # which of them is a matter of the machine
    named = {"torch", "pycolmap", "opencv-contrib-python-headless", "ffmpeg-python", "zxing-cpp"}
    assert named <= findings.keys()
    assert findings["numpy"].found == metadata.version("numpy")
    assert "instruction set" in findings["C++ core"].found
    assert "ultralytics" not in findings  # extras are not missed


@pytest.mark.parametrize(
    ("code", "said", "found", "remedy"),
    [
        (0, "", "1.0", ""),
        (
            1,
            "ImportError: libusb-1.0.so.0: cannot open shared object file: No such file",
            "libusb-1.0.so.0 is missing",
            "sudo apt-get install libgl1 libegl1 libx11-6 libusb-1.0-0",
        ),
        (1, "ImportError: libodd.so.3: cannot open shared object file", "libodd.so.3", "package that has libodd.so.3"),
        (-4, "", "signal 4", "build of lib for this processor"),
        (1, "Traceback\nValueError: numpy too old\n", "numpy too old", "--force-reinstall lib"),
        (1, "", "no reason was given", "--force-reinstall lib"),
    ],
)
def test_failed_imports_name_what_to_do(code, said, found, remedy):
    finding = doctor._import_finding("lib", "1.0", code, said)
    assert found in finding.found
    assert remedy in finding.remedy
    assert bool(finding.remedy) == finding.fatal == (code != 0)


def test_a_missing_library_is_named(monkeypatch, tmp_path):
    monkeypatch.setattr(doctor, "_list_libraries", lambda: ["numpy", "no-such-library"])
    missing = doctor.examine(tmp_path)[2]
    assert (missing.found, missing.remedy, missing.fatal) == ("missing", "pip install no-such-library", True)


def test_ffmpeg_without_the_phones_codecs_is_told(monkeypatch):
    monkeypatch.setattr(
        doctor, "_output_of", lambda *command: "ffmpeg version 1\n V....D h264   H.264\n A..... hevc x\n"
    )
    codecs = doctor._examine_ffmpeg()[1]
    assert codecs.found == "no hevc"
    assert codecs.remedy


def test_without_ffmpeg_the_machine_is_unusable(monkeypatch):
    monkeypatch.setattr(doctor, "ffmpeg_binary", lambda: "/nowhere/ffmpeg")
    (finding,) = doctor._examine_ffmpeg()
    assert finding.fatal
    assert finding.remedy == "sudo apt-get install ffmpeg"


def test_it_ends_with_a_verdict_that_the_exit_code_follows():
    fine, small = doctor.Finding("numpy", "2.0"), doctor.Finding("memory", "2 GiB", "use --preset draft")
    lacking = doctor.Finding("ffmpeg", "missing", "sudo apt-get install ffmpeg", fatal=True)
    assert (doctor.conclude([fine]), doctor.is_ready([fine])) == ("ready", True)
    assert (doctor.conclude([fine, small]), doctor.is_ready([fine, small])) == ("ready, but look at memory", True)
    assert doctor.conclude([small, lacking]).startswith("not ready: ffmpeg must be mended first")
    assert not doctor.is_ready([small, lacking])


def test_a_folder_that_is_not_there_is_told(tmp_path):
    with pytest.raises(MissingInput, match="nosuch is not a folder"):
        doctor.examine(tmp_path / "nosuch")


def test_the_exit_code_tells_what_is_missing(tmp_path):
    command = [*DOCTOR, str(tmp_path)]
    bare = subprocess.run(command, capture_output=True, text=True, check=False, env={"PATH": "/nowhere", "HOME": "/"})
    assert "C++ core" in bare.stdout
    assert bare.returncode in (0, 3)  # imageio-ffmpeg may bring its own
    assert ("sudo apt-get install ffmpeg" in bare.stdout) == (bare.returncode == 3)


@pytest.mark.parametrize(
    ("remedy", "root", "commands"),
    [
        ("pip install numpy", False, [[sys.executable, "-m", "pip", "install", "numpy"]]),
        (
            "sudo apt-get install libgl1 libx11-6",
            True,
            [["apt-get", "update", "-q"], ["apt-get", "install", "-y", "-q", "libgl1", "libx11-6"]],
        ),
        ("sudo apt-get install libgl1", False, []),
        ("free some space: a plant takes about 0.5 GiB", True, []),
        ("install an ffmpeg with them: sudo apt-get install ffmpeg", True, []),
    ],
)
def test_only_commands_that_this_user_may_run_are_run(monkeypatch, remedy, root, commands):
    monkeypatch.setattr(doctor, "_as_root", lambda: [] if root else None)
    monkeypatch.setattr(doctor.shutil, "which", lambda name: f"/usr/bin/{name}")
    assert doctor._commands_of(remedy) == commands


def test_what_cannot_be_mended_is_named(monkeypatch):
    said, run = [], []
    monkeypatch.setattr(doctor, "_commands_of", lambda remedy: [[remedy, "now"]] if remedy != "buy a disk" else [])
    monkeypatch.setattr(
        doctor.subprocess, "run", lambda command, **_: run.append(command) or subprocess.CompletedProcess(command, 1)
    )
    findings = [doctor.Finding("a", "", remedy) for remedy in ("buy a disk", "one", "one", "")]
    doctor.mend(findings, said.append)
    assert run == [["one", "now"]]
    assert said == ["left to you: buy a disk", "$ one now", "failed: one"]


def test_doctor_fix_installs_a_library_that_was_taken_away(tmp_path):
    """In an environment of its own whose pip finds a wheel made here."""
    wheel = tmp_path / "absent_thing-1.0-py3-none-any.whl"
    with zipfile.ZipFile(wheel, "w") as archive:
        archive.writestr("absent_thing.py", "")
        archive.writestr(
            "absent_thing-1.0.dist-info/METADATA", "Metadata-Version: 2.1\nName: absent-thing\nVersion: 1.0\n"
        )
        archive.writestr(
            "absent_thing-1.0.dist-info/WHEEL", "Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: py3-none-any\n"
        )
        archive.writestr("absent_thing-1.0.dist-info/RECORD", "")
    venv = tmp_path / "venv"
    subprocess.run([sys.executable, "-m", "venv", "--system-site-packages", venv], check=True)
    here = [path for path in sys.path if path]
    script = (
        f"import sys; sys.path += {here!r}\n"
        "from cotton3dg.commands import doctor\n"
        f"doctor._list_libraries = lambda: ['absent_thing']\n"
        f"finding = doctor._examine_library('absent_thing')\n"
        "assert finding.found == 'missing', finding\n"
        "doctor.mend([finding], print)\n"
        "print(doctor._examine_library('absent_thing'))\n"
    )
    settings = {"PIP_NO_INDEX": "1", "PIP_FIND_LINKS": str(tmp_path), "PATH": "/usr/bin:/bin"}
    done = subprocess.run(
        [venv / "bin" / "python", "-c", script], capture_output=True, text=True, env=settings, check=False
    )
    assert "found='1.0', remedy=''" in done.stdout, done.stdout + done.stderr
