# SPDX-License-Identifier: Apache-2.0
"""Makes the wheel for pip (PEP 517), from a build of its own or from the finished one that $CITYLEARN_BUILD names. Where
that build has Debian packages (`./run package`), the wheel has their programs too, and the command citylearn."""

import base64
import hashlib
import io
import os
import re
import subprocess
import sys
import sysconfig
import tarfile
import tempfile
import zipfile
from pathlib import Path

HERE = Path(__file__).resolve().parent
SOURCE = HERE.parent
MODULE = f"_native{sysconfig.get_config_var('EXT_SUFFIX')}"


def built_package():
    """Returns the folder of the built package. Ends pip with one line where the build is not one for this Python."""
    given = os.environ.get("CITYLEARN_BUILD")
    if given:  # pip calls this in python/, but a relative path was typed elsewhere
        places = [Path(start, given).absolute() for start in (os.environ.get("PWD", SOURCE), SOURCE)]
        build = next((place for place in places if (place / "python/citylearn").is_dir()), None)
        if not build:
            sys.exit(f"CITYLEARN_BUILD: there is no build in {' or '.join(dict.fromkeys(map(str, places)))}; "
                     "make one (./run build), or leave CITYLEARN_BUILD unset")
    else:
        build = SOURCE / "build" / f"python-{sys.implementation.cache_tag}"
        subprocess.run(["cmake", "-S", SOURCE, "-B", build, "-G", "Ninja", "-DCMAKE_BUILD_TYPE=Release",
                        "-DCITYLEARN_PYTHON=ON", "-DCITYLEARN_TESTS=OFF", "-DCITYLEARN_BENCH=OFF",
                        f"-DPython_EXECUTABLE={sys.executable}"], check=True)
        subprocess.run(["cmake", "--build", build, "--target", "citylearn_python"], check=True)
    package = build / "python/citylearn"
    for name in (MODULE, *(path.name for path in (HERE / "citylearn").glob("*.py"))):
        if not (package / name).is_file():
            others = ", ".join(path.name for path in package.glob("_native.*")) if name == MODULE else ""
            sys.exit(f"CITYLEARN_BUILD: {package} has no {name}" + (
                f", which {sys.executable} needs, but {others}; take the Python that it is for, or leave "
                "CITYLEARN_BUILD unset" if others else "; finish the build, or leave CITYLEARN_BUILD unset"))
    # In a process of its own, because a module that was not written whole may end it.
    load = [sys.executable, "-c", "import ctypes, sys; ctypes.CDLL(sys.argv[1])", package / MODULE]
    if subprocess.run(load, check=False).returncode:
        sys.exit(f"CITYLEARN_BUILD: {package / MODULE} does not load; remove it and build it again")
    return package


def libraries(module):
    """Returns the Debian packages of the libraries that the module names: it uses others than the programs do."""
    names = re.findall(r"NEEDED\s+(\S+)", subprocess.run(["objdump", "-p", module], check=True, capture_output=True, text=True).stdout)
    places = [f"*/lib/{folder}{name}" for name in names for folder in ("", f"{sysconfig.get_config_var('MULTIARCH')}/")]
    found = subprocess.run(["dpkg-query", "--search", *places], check=False, capture_output=True, text=True)
    return set(re.findall(r"^([^:,\s]+)", found.stdout, re.MULTILINE))


def programs(build):
    """Returns the files of the wheel that come from a build's Debian packages, and the packages that it depends on."""
    files, needed = {}, set()
    packages = [next(build.glob(f"packages/citylearn-{part}_*.deb"), None) for part in ("services", "dashboard")]
    if None in packages:
        return files, needed
    for package in packages:
        fields = subprocess.run(["dpkg-deb", "--field", package, "Depends"], check=True, capture_output=True, text=True)
        for field in fields.stdout.split(","):
            name = re.match(r"[^ |(:]*", field.strip())[0]
            if not name.startswith(("citylearn-", "systemd")):  # those of the services of a host
                needed.add(name)
        with tempfile.TemporaryDirectory() as folder:
            subprocess.run(["dpkg-deb", "--extract", package, folder], check=True)
            for part in ("bin", "share/citylearn"):
                for path in Path(folder, "usr", part).rglob("*"):
                    if path.is_file():
                        files[f"citylearn/installed/{path.relative_to(Path(folder, 'usr'))}"] = path.read_bytes()
    needed |= libraries(build / "python/citylearn" / MODULE)
    files["{data}/scripts/citylearn"] = (HERE / "citylearn_command.py").read_bytes()
    return files, needed


def version():
    return re.search(r"project\(citylearn VERSION (\S+)", (SOURCE / "CMakeLists.txt").read_text())[1]


def metadata(name, *fields):
    return "".join(f"{field}\n" for field in (
        "Metadata-Version: 2.1", f"Name: {name}", f"Version: {version()}", "License: Apache-2.0", *fields)).encode()


def write_wheel(folder, name, tag, files, *fields):
    """Writes a wheel of these files by path, with more fields of its metadata. Returns its file name."""
    module = f"{name.replace('-', '_')}-{version()}"
    info = f"{module}.dist-info"
    files = {path.replace("{data}", f"{module}.data"): data for path, data in files.items()}
    files[f"{info}/METADATA"] = metadata(name, *fields)
    pure = "true" if tag.endswith("-any") else "false"
    files[f"{info}/WHEEL"] = f"Wheel-Version: 1.0\nGenerator: citylearn\nRoot-Is-Purelib: {pure}\nTag: {tag}\n".encode()
    files[f"{info}/LICENSE"] = (SOURCE / "LICENSE").read_bytes()
    digest = {path: base64.urlsafe_b64encode(hashlib.sha256(data).digest()).rstrip(b"=").decode()
              for path, data in files.items()}
    record = "".join(f"{path},sha256={digest[path]},{len(data)}\n" for path, data in files.items())
    files[f"{info}/RECORD"] = f"{record}{info}/RECORD,,\n".encode()
    wheel_name = f"{module}-{tag}.whl"
    with zipfile.ZipFile(Path(folder, wheel_name), "w", zipfile.ZIP_DEFLATED) as wheel:
        for path, data in files.items():
            file = zipfile.ZipInfo(path)
            file.compress_type = zipfile.ZIP_DEFLATED
            file.external_attr = (0o100755 if "/bin/" in path or "/scripts/" in path else 0o100644) << 16
            wheel.writestr(file, data)
    return wheel_name


def write_own_wheel(folder, files, *fields):
    """Writes the wheel of citylearn for this Python, as write_wheel() does."""
    tag = "cp{0.major}{0.minor}-cp{0.major}{0.minor}-".format(sys.version_info)
    tag += re.sub(r"[-.]", "_", sysconfig.get_platform())
    return write_wheel(folder, "citylearn-dds", tag, files, "Summary: Visual navigation over recorded routes",
                       "Requires-Python: >=3.10", "Requires-Dist: numpy", *fields)


def build_wheel(wheel_directory, config_settings=None, metadata_directory=None):
    package = built_package()
    files, needed = programs(package.parents[1])
    files |= {f"citylearn/{path.name}": path.read_bytes() for path in sorted(package.glob("*.*"))
              if path.suffix in (".py", ".typed") or path.name == MODULE}
    return write_own_wheel(wheel_directory, files, *(f"Requires-External: {name}" for name in sorted(needed)))


def build_editable(wheel_directory, config_settings=None, metadata_directory=None):
    """Makes what `pip install --editable` installs (PEP 660): where the build is, in which Python files are links."""
    return write_own_wheel(wheel_directory, {"citylearn_dds.pth": f"{built_package().parent}\n".encode()})


def build_sdist(sdist_directory, config_settings=None):
    """Makes an archive of all files that git knows, from which pip builds as it does from this folder."""
    names = subprocess.run(["git", "ls-files", "-z"], cwd=SOURCE, check=True, capture_output=True, text=True).stdout
    folder = f"citylearn_dds-{version()}"
    project = (HERE / "pyproject.toml").read_text().replace('backend-path = ["."]', 'backend-path = ["python"]')
    with tarfile.open(Path(sdist_directory, f"{folder}.tar.gz"), "w:gz") as archive:
        for name in names.rstrip("\0").split("\0"):
            archive.add(SOURCE / name, f"{folder}/{name}", recursive=False)
        for name, data in (("pyproject.toml", project.encode()), ("PKG-INFO", metadata("citylearn-dds"))):
            file = tarfile.TarInfo(f"{folder}/{name}")
            file.size = len(data)
            archive.addfile(file, io.BytesIO(data))
    return f"{folder}.tar.gz"
