#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""sbom.py SOURCE BUILD OUTPUT: what tokid consists of, as CycloneDX 1.5 in JSON: the shared libraries that the programs
of the build tree load and their own, the headers that were compiled in, what is in src/report/vendor, and what the
Python package asks for. Versions are those of this machine's Debian packages; the same machine gives the same bytes."""

import json
import re
import subprocess
import sys
import tomllib
from pathlib import Path
from urllib.parse import quote

# Debian packages that the build takes nothing from but headers
HEADERS = ("libeigen3-dev", "libboost-dev", "libcli11-dev", "nlohmann-json3-dev", "libhwy-dev", "libxxhash-dev")


def output(*words):
    return subprocess.run([str(word) for word in words], check=True, capture_output=True, text=True).stdout


def loaded(program):
    """The shared libraries that the loader finds for it."""
    found = re.findall(r"(?:=> )?(/\S+) \(0x", output("ldd", program))
    return {Path(path).resolve() for path in found}


def owners(paths):
    """The packages of files; the loader may know them by the names before /lib became /usr/lib."""
    names = {name: path for path in paths for name in (str(path), str(path).removeprefix("/usr"))}
    found = subprocess.run(["dpkg-query", "--search", *names], capture_output=True, text=True, check=False).stdout
    packages = {names[file]: package.split(",")[0] for package, file in re.findall(r"^(\S.*): (/\S+)$", found, re.MULTILINE)
                if file in names}
    if missing := set(paths) - set(packages):
        sys.exit(f"{', '.join(map(str, sorted(missing)))}: of no Debian package, one needed")
    return sorted(set(packages.values()))


def debian(packages, note):
    shown = output("dpkg-query", "--show",
                   "--showformat=${Package}\t${Version}\t${Architecture}\t${Homepage}\n", *packages)
    components = []
    for line in shown.splitlines():
        name, version, architecture, homepage = line.split("\t")
        purl = f"pkg:deb/debian/{quote(name)}@{quote(version)}?arch={architecture}"
        component = {"type": "library", "bom-ref": purl, "name": name, "version": version, "purl": purl,
                     "scope": "required", "properties": [{"name": "tokid:use", "value": note}]}
        if homepage:
            component["externalReferences"] = [{"type": "website", "url": homepage}]
        components.append(component)
    return components


def uplot(source):
    folder = source / "src" / "report" / "vendor" / "uplot"
    version = re.search(r"uPlot ([0-9.]+)", (source / "NOTICE").read_text()).group(1)
    digest = output("sha256sum", folder / "uPlot.iife.min.js").split()[0]
    purl = f"pkg:npm/uplot@{version}"
    return {"type": "library", "bom-ref": purl, "name": "uPlot", "version": version, "purl": purl, "scope": "required",
            "hashes": [{"alg": "SHA-256", "content": digest}], "licenses": [{"license": {"id": "MIT"}}],
            "properties": [{"name": "tokid:use", "value": "part of the pages, src/report/vendor/uplot"}]}


def python_packages(source):
    """Those that pyproject.toml names, in the versions that the tests run with."""
    project = tomllib.loads((source / "pyproject.toml").read_text())
    files = [source / "python" / f"requirements-{use}.txt" for use in ("build", "test")]
    tested = dict(re.findall(r"^([A-Za-z0-9_-]+)==(\S+)$", "".join(file.read_text() for file in files), re.MULTILINE))
    wanted = [(text, "required", "the Python package") for text in project["project"]["dependencies"]]
    for extra, texts in project["project"]["optional-dependencies"].items():
        wanted += [(text, "optional", f"the Python package, tokid[{extra}]") for text in texts]
    wanted += [(text, "excluded", "builds the Python package") for text in project["build-system"]["requires"]]
    components = {}
    for text, scope, note in wanted:
        name = re.match(r"[A-Za-z0-9_-]+", text).group()
        if name == "tokid" or name in components:
            continue
        version = tested.get(name)
        purl = f"pkg:pypi/{name}" + (f"@{version}" if version else "")
        components[name] = {"type": "library", "bom-ref": purl, "name": name,
                            **({"version": version} if version else {}), "purl": purl, "scope": scope,
                            "properties": [{"name": "tokid:use", "value": f"{note}, asked for as {text}"}]}
    return list(components.values())


def version_of(source):
    return re.search(r"project\(tokid VERSION ([0-9.]+)", (source / "CMakeLists.txt").read_text()).group(1)


def write(source, components, target):
    version = version_of(source)
    own = {"type": "application", "bom-ref": f"pkg:generic/tokid@{version}", "name": "tokid", "version": version,
           "licenses": [{"license": {"id": "BSD-3-Clause"}}]}
    needed = [component["bom-ref"] for component in components if component["scope"] == "required"]
    bom = {"bomFormat": "CycloneDX", "specVersion": "1.5", "version": 1, "metadata": {"component": own},
           "components": components, "dependencies": [{"ref": own["bom-ref"], "dependsOn": needed}]}
    target.write_text(json.dumps(bom, indent=1, ensure_ascii=False) + "\n")


def main():
    source, build, target = (Path(word) for word in sys.argv[1:4])
    files = [build / "bin" / "tokid", *sorted((build / "lib").glob("libtokid.so"))]
    libraries = {path for file in files for path in loaded(file) if path.name.split(".so")[0] != "libtokid"}
    components = debian(owners(libraries), "loaded at run time")
    components += debian(HEADERS, "headers that are compiled in")
    write(source, [*components, uplot(source), *python_packages(source)], target)


if __name__ == "__main__":
    main()
