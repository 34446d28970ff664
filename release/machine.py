# SPDX-License-Identifier: BSD-3-Clause
"""A Debian that debootstrap makes in a folder, for what has to be tried on a machine that has nothing else."""

import os
import platform
import shutil
import subprocess
import sys
import time
from pathlib import Path

# What apt and dpkg keep for themselves, and what programs leave in /tmp
NOT_OURS = ("proc", "tmp", "var/cache", "var/lib/apt", "var/lib/dpkg", "var/log")

# Processes in the folder see nothing else of this machine but its processors and the network. Nothing stays mounted:
# the mount namespace ends with them.
ENTER = """
mount -t proc proc "$0/proc" && mount --rbind /sys "$0/sys" && mount -t tmpfs tmpfs "$0/dev/shm" &&
mount -t devpts -o newinstance,ptmxmode=0666 devpts "$0/dev/pts" && exec chroot "$0" "$@"
"""


def run(*words, **options):
    """Its output; all of it is shown where it fails."""
    done = subprocess.run([str(word) for word in words], stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
                          stderr=subprocess.STDOUT, text=True, errors="replace", check=False, **options)
    if done.returncode != 0:
        sys.exit(f"{done.stdout}\n{' '.join(map(str, words))}: exit code {done.returncode}")
    return done.stdout


def need(condition, text):
    if not condition:
        sys.exit(f"failed: {text}")


def own_release():
    return platform.freedesktop_os_release()["VERSION_CODENAME"]


def mirror():
    """Of this machine's apt. It has the other releases, too."""
    lines = run("apt-get", "indextargets", "--format", "$(SITE) $(RELEASE)", "Created-By: Packages").splitlines()
    sites = [site for site, name in map(str.split, lines) if name == own_release()]
    need(sites, f"no source of apt for {own_release()}")
    return sites[0]


class Machine:
    """`release` is the name of a Debian, this machine's unless another one is given; `architecture` that of a second one
    whose packages may be installed. A machine that is there already is kept on demand."""

    def __init__(self, root, release=None, architecture=None, keep=False):
        self.root = root
        finished = root / "etc/apt/apt.conf.d/99acquire"
        if keep and finished.exists():
            return
        shutil.rmtree(root, ignore_errors=True)
        root.parent.mkdir(parents=True, exist_ok=True)
        run("debootstrap", "--variant=minbase", release or own_release(), root, mirror())
        if "PIP_CERT" in os.environ:
            shutil.copy(os.environ["PIP_CERT"], root / "etc/pip.pem")
        if architecture:
            self("dpkg", "--add-architecture", architecture)
        finished.write_text(run("apt-config", "dump", "Acquire"))
        self("apt-get", "update")

    def __call__(self, *words):
        kept = {name: value for name, value in os.environ.items()
                if name.lower().endswith("_proxy") or name == "PIP_INDEX_URL"}
        if (self.root / "etc/pip.pem").exists():
            kept["PIP_CERT"] = "/etc/pip.pem"
        environment = kept | {"PATH": "/usr/sbin:/usr/bin:/sbin:/bin", "HOME": "/root", "LC_ALL": "C.UTF-8",
                              "DEBIAN_FRONTEND": "noninteractive"}
        return run("unshare", "--mount", "sh", "-c", ENTER, self.root, *words, env=environment)

    def install(self, *packages):
        self("apt-get", "install", "--yes", "--no-install-recommends", *packages)

    def files(self):
        found = set()
        for folder, folders, files in os.walk(self.root):
            here = Path(folder).relative_to(self.root)
            folders[:] = [name for name in folders if str(here / name) not in NOT_OURS]
            found |= {str(here / name) for name in (*folders, *files)}
        return found


class Steps:
    """Prints each with its time."""

    def __init__(self):
        self.begin = time.monotonic()

    def __call__(self, text):
        now = time.monotonic()
        print(f"{now - self.begin:6.1f} s  {text}", flush=True)
        self.begin = now
