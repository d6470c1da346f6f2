# SPDX-License-Identifier: Apache-2.0
"""What docs/install.md and the README ask of a new user, in a Debian with nothing in it: `make bare-test` (as root).

    python tests/stress/bare_machine.py /tmp/bare [--by checkout|wheel|sdist] [--user] [--lend FOLDER ...]

Makes the smallest Debian of this system's release in the folder with debootstrap and does what a page says, as it
stands: a clone of this repository's last commit and `make demo`, or the one line for a wheel or an sdist of `make
wheel` (in dist/) and `cotton3dg demo`. Prints the row, the seconds, and the megabytes that were installed. pip's
environment variables and configuration and the certificates of this machine hold there, too; folders that they name are
to be lent. The folder is kept, and its Debian used again; remove it by hand.
"""

from __future__ import annotations

import argparse
import os
import platform
import re
import shutil
import subprocess
import sys
import time
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

ROOT = Path(__file__).parents[2]
SETTINGS = ("etc/apt", "etc/pip.conf", "etc/resolv.conf", "etc/hosts")
CERTIFICATES = Path("/etc/ssl/certs/ca-certificates.crt")
HOME = "home/new"
"""Of the new user, in the other system."""
USER = 1000
BEGIN = 'set -e\nsudo() { env "$@"; }  # not there, and this is root\ncd "$HOME"\nrm -rf cotton3dg demo\n'
EXTRA_INDEX = "export PIP_EXTRA_INDEX_URL="
BEFORE = {"checkout": "", "wheel": "python3 python3-venv", "sdist": "python3 python3-venv python3-dev g++"}
"""Packages that a machine has, or its administrator installs, before the page is followed."""


def commands(by: str) -> str:
    """The block of install.md, and the demo."""
    if by == "checkout":
        lines = [*block_of("Developers"), "make demo"]
    else:
        file = f"cotton3dg-*_{platform.machine()}.whl" if by == "wheel" else "cotton3dg-*.tar.gz"
        lines = [f"cp /source/dist/{file} .", *block_of("In one line")]
        if by == "sdist":
            lines = [line.replace("-*.whl", "-*.tar.gz") for line in lines]
        lines += ["du -sm cotton3dg | sed 's/$/ MB installed/'"]
    lines = [line.replace("URL_OF_THIS_REPOSITORY", "/source") for line in lines]
    # Of an index that cannot be reached pip would ask again and again; what it has is to be lent then.
    lines = [line for line in lines if not line.startswith(EXTRA_INDEX) or reachable(line.removeprefix(EXTRA_INDEX))]
    timed = [line for one in lines for line in (f"echo '$ {one}'", one, 'echo "after $SECONDS s"')]
    return BEGIN + "\n".join([*timed, "cat demo/traits/traits.csv", ""])


def reachable(address: str) -> bool:
    try:
        with urllib.request.urlopen(address, timeout=20):
            return True
    except OSError:
        return False


def block_of(heading: str) -> list[str]:
    """Commands of the first block below a heading of install.md."""
    page = (ROOT / "docs" / "install.md").read_text(encoding="utf-8")
    block = re.search(rf"^## {heading}[^#]*?\n((?:    .*\n)+)", page, re.M)
    assert block is not None
    return [line.strip() for line in block[1].splitlines()]


def release() -> tuple[str, str]:
    """Code name and mirror of this system's packages."""
    name = re.search(r"^VERSION_CODENAME=(\w+)", Path("/etc/os-release").read_text(), re.M)
    said = "".join(
        path.read_text() for path in sorted(Path("/etc/apt").rglob("*.*")) if path.suffix in (".list", ".sources")
    )
    mirror = re.search(r"^(?:URIs:|deb)[^#\n]*?(https?://\S+)", said, re.M)
    if name is None or mirror is None:
        sys.exit("this needs a Debian or Ubuntu with its package sources in /etc/apt")
    return name[1], mirror[1]


@contextmanager
def lent(system: Path, folders: list[Path]) -> Iterator[None]:
    """Mount folders of this machine in the other, at the same place."""
    mounted: list[Path] = []
    try:
        for source, inside in [(ROOT, "source"), *((folder, str(folder)[1:]) for folder in folders)]:
            target = system / inside
            target.mkdir(parents=True, exist_ok=True)
            subprocess.run(["mount", "--bind", "-o", "ro", source, target], check=True)
            mounted.append(target)
        yield
    finally:
        for target in reversed(mounted):
            subprocess.run(["umount", target], check=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--by", choices=BEFORE, default="checkout", help="what is installed")
    parser.add_argument("--user", action="store_true", help="as an ordinary user, who may install no packages")
    parser.add_argument("--lend", type=Path, nargs="*", default=[], help="folders that pip's configuration names")
    wanted = parser.parse_args()
    system: Path = wanted.folder.resolve()
    if not (system / "usr" / "bin" / "apt-get").exists():
        system.mkdir(parents=True, exist_ok=True)
        subprocess.run(["debootstrap", "--variant=minbase", release()[0], system, release()[1]], check=True)
    copies = {Path("/", file): system / file for file in SETTINGS}
    for file, copy in (copies | {Path.home() / ".config" / "pip": system / HOME / ".config" / "pip"}).items():
        if file.exists():
            copy.parent.mkdir(parents=True, exist_ok=True)
            subprocess.run(["cp", "-aLT", file, copy], check=True)
    # Not in the place of the system's own, which installing ca-certificates would make anew.
    shutil.copyfile(CERTIFICATES, system / "etc" / "lent.crt")
    (system / "etc" / "apt" / "apt.conf.d" / "90yes").write_text('APT::Get::Assume-Yes "true";\n')
    (system / HOME).mkdir(parents=True, exist_ok=True)
    (system / HOME / "commands.sh").write_text(commands(wanted.by))
    (system / "tmp").chmod(0o1777)
    owner = USER if wanted.user else 0
    subprocess.run(["chown", "-R", f"{owner}:{owner}", system / HOME], check=True)
    kept = [f"{key}={value}" for key, value in os.environ.items() if re.match("PIP_|(https?|no)_proxy", key, re.I)]
    kept += ["PIP_CONSTRAINT=/source/constraints.txt"] if wanted.by != "checkout" else []
    kept += [f"{name}=/etc/lent.crt" for name in ("PIP_CERT", "SSL_CERT_FILE", "REQUESTS_CA_BUNDLE")]
    inside = ["env", "-i", f"HOME=/{HOME}", "PATH=/usr/sbin:/usr/bin:/sbin:/bin", *kept]
    with lent(system, [Path("/proc"), *wanted.lend]):
        if BEFORE[wanted.by]:
            packages = f"apt-get update -q && apt-get install -q --no-install-recommends {BEFORE[wanted.by]}"
            subprocess.run(["chroot", system, *inside, "sh", "-c", packages], check=True, stdout=subprocess.DEVNULL)
        command = ["chroot", f"--userspec={owner}:{owner}", system, *inside, "bash", f"/{HOME}/commands.sh"]
        began = time.monotonic()
        done = subprocess.run(command, check=False)
    print(f"{wanted.by}, user {owner}: exit {done.returncode} after {time.monotonic() - began:.0f} s")
    sys.exit(done.returncode)


if __name__ == "__main__":
    main()
