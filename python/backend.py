# SPDX-License-Identifier: Apache-2.0
"""Makes the wheel for pip (PEP 517), from a build of its own or from the finished one that $CITYLEARN_BUILD names."""

import base64
import hashlib
import os
import re
import subprocess
import sys
import sysconfig
import zipfile
from pathlib import Path

HERE = Path(__file__).resolve().parent
SOURCE = HERE.parent


def built_package():
    """Returns the folder of the built package."""
    build = os.environ.get("CITYLEARN_BUILD")
    if not build:
        build = str(SOURCE / "build/python")
        subprocess.run(["cmake", "-S", SOURCE, "-B", build, "-G", "Ninja", "-DCMAKE_BUILD_TYPE=Release",
                        "-DCITYLEARN_PYTHON=ON", "-DCITYLEARN_TESTS=OFF", "-DCITYLEARN_BENCH=OFF",
                        f"-DPython_EXECUTABLE={sys.executable}"], check=True)
        subprocess.run(["cmake", "--build", build, "--target", "citylearn_python"], check=True)
    return Path(build).absolute() / "python/citylearn"


def build_wheel(wheel_directory, config_settings=None, metadata_directory=None):
    version = re.search(r"project\(citylearn VERSION (\S+)", (SOURCE / "CMakeLists.txt").read_text())[1]
    tag = "cp{0.major}{0.minor}-cp{0.major}{0.minor}-".format(sys.version_info)
    tag += re.sub(r"[-.]", "_", sysconfig.get_platform())
    info = f"citylearn-{version}.dist-info"
    files = {f"citylearn/{path.name}": path.read_bytes() for path in sorted(built_package().glob("*.*"))
             if path.suffix in (".py", ".typed", ".so")}
    files[f"{info}/METADATA"] = (f"Metadata-Version: 2.1\nName: citylearn\nVersion: {version}\n"
                                 "Summary: Visual navigation over recorded routes\nLicense: Apache-2.0\n"
                                 "Requires-Python: >=3.9\nRequires-Dist: numpy\n").encode()
    files[f"{info}/WHEEL"] = f"Wheel-Version: 1.0\nGenerator: citylearn\nRoot-Is-Purelib: false\nTag: {tag}\n".encode()
    files[f"{info}/LICENSE"] = (SOURCE / "LICENSE").read_bytes()
    digest = {name: base64.urlsafe_b64encode(hashlib.sha256(data).digest()).rstrip(b"=").decode()
              for name, data in files.items()}
    record = "".join(f"{name},sha256={digest[name]},{len(data)}\n" for name, data in files.items())
    files[f"{info}/RECORD"] = f"{record}{info}/RECORD,,\n".encode()
    name = f"citylearn-{version}-{tag}.whl"
    with zipfile.ZipFile(Path(wheel_directory, name), "w", zipfile.ZIP_DEFLATED) as wheel:
        for path, data in files.items():
            wheel.writestr(path, data)
    return name
