# SPDX-License-Identifier: Apache-2.0
"""Encoders that are Python functions. Where an option is `--encoder FILE.py`, our programs run this source as a process of its
own, with FILE.py as argument. It runs FILE.py, whose call of serve_encoder then answers pictures with vectors over a socket.
The other side is encoder_service/encoders/python.cc. It needs NumPy, and not this package's module."""

import hashlib
import os
import re
import select
import shutil
import socket
import struct
import sys
import threading
import time
import traceback
import types

MAX_DIMENSION, MAX_BATCH, MAX_SIDE, MAX_TEXT = 65536, 1024, 4096, 500
TRIAL_SIZE = 320, 240  # width and height of the trial's pictures where FILE.py names none
TOLERANCE = 1e-2  # of a vector's length: numbers of 16 bits round otherwise in other batches

_link = _path = _hash = numpy = None  # the socket, FILE.py, its hash and the module, in a process of our programs


class Fault(Exception):
    """A fault whose text is for a person."""


def receive(size):
    """Returns that many bytes. Ends this process when the program at the other end is gone."""
    data, done = bytearray(size), 0
    while done < size:
        done += _link.recv_into(memoryview(data)[done:]) or os._exit(0)
    return data


def report(error):
    """Sends what was raised as one line with the line of FILE.py. Prints the traceback unless the line says all."""
    lines = [str(frame.lineno) for frame in traceback.extract_tb(error.__traceback__) if frame.filename == _path]
    if isinstance(error, SyntaxError) and error.filename == _path:
        lines = [str(error.lineno)]
    texts = traceback.format_exception_only(type(error), error)
    text = " ".join("".join(texts[-1:] if isinstance(error, SyntaxError) else texts).split())[:MAX_TEXT]
    if isinstance(error, Fault):
        lines, text = [], str(error)
    elif isinstance(error, ImportError):
        text += f" (the interpreter is {sys.executable}; CITYLEARN_PYTHON names another, as venv/bin/python3)"
    elif not isinstance(error, SyntaxError):
        traceback.print_exception(type(error), error, error.__traceback__)
    line = ": ".join([":".join([_path, *lines[-1:]]), text]).encode(errors="replace")[:4000]
    _link.sendall(struct.pack("<i", len(line)) + line)


def vectors_of(encode, pictures, dimension):
    """Returns what encode() makes of n pictures as n x D floats. Raises Fault when they are anything else."""
    count, result = len(pictures), encode(pictures)
    if hasattr(result, "detach"):  # a tensor of PyTorch, perhaps on a GPU
        result = result.detach().cpu().float().numpy()
    what = f"numbers of shape {tuple(result.shape)}" if hasattr(result, "shape") else f"a {type(result).__name__}"
    try:
        result = numpy.asarray(result)
    except Exception:  # parts of a tuple or list differ
        result = numpy.empty(())
    wanted = [dimension] if dimension else range(1, MAX_DIMENSION + 1)
    if result.ndim != 2 or len(result) != count or result.shape[1] not in wanted:
        raise Fault(f"the function gives {what} for {count} pictures, not an array of shape "
                    f"({count}, {dimension or f'1 to {MAX_DIMENSION}'})")
    if result.dtype.kind != "f":
        raise Fault(f"the function gives numbers of type {result.dtype}, not float32")
    with numpy.errstate(over="ignore"):
        result = numpy.ascontiguousarray(result, "<f4")
    wrong = numpy.flatnonzero(~numpy.isfinite(result).all(axis=1))
    if wrong.size:
        raise Fault(f"the function gives NaN or infinite numbers for picture {wrong[0]} of {count}")
    return result


def trial(encode, dimension, size, batch):
    """Returns the dimension and the seconds of a picture. Raises Fault when the same picture gets other numbers."""
    pictures = numpy.random.default_rng(1).integers(0, 256, (2, *reversed(size or TRIAL_SIZE), 3), numpy.uint8)
    alone = vectors_of(encode, pictures[:1].copy(), dimension)
    start = time.monotonic()
    again = vectors_of(encode, pictures[:1].copy(), alone.shape[1])
    seconds = time.monotonic() - start
    beside = vectors_of(encode, pictures.copy(), alone.shape[1]) if batch > 1 else alone
    for other, when in (again, "each time for the same picture"), (beside[:1], "for a picture when another is beside it"):
        if numpy.linalg.norm(other - alone) > TOLERANCE * numpy.linalg.norm(alone):
            raise Fault(f"the function gives other numbers {when} (does FILE.py call model.eval()?)")
    return alone.shape[1], seconds


def serve_encoder(encode, *, dimension=None, size=None, batch=16, version="1"):
    """Makes a function an encoder: the last call of FILE.py, which any program takes as --encoder FILE.py.

    encode: takes n pictures (uint8, n x height x width x 3, red, green, blue; n is at most `batch`) and returns n vectors
        (float32, n x D; a tensor of PyTorch on any device may be one). Its numbers must depend on the picture alone.
    dimension: D; found by a trial where it is left out.
    size: width and height in pixels to which pictures are resized, or one number for both. Without it each picture
        comes as it is, and those of one call have one size.
    version: part of the name under which vectors are stored, beside the hash of FILE.py. Change it with whatever else
        changes numbers: weights, libraries.
    """
    if sys.modules.get("__mp_main__", sys).__name__ == "__mp_main__":  # a worker of multiprocessing imports FILE.py
        return
    if not _link:
        program, file = shutil.which("citylearn"), getattr(sys.modules["__main__"], "__file__", None)
        if not program or not file:
            sys.exit("citylearn.serve_encoder: start this file by ./run encoder --encoder FILE.py")
        os.environ["CITYLEARN_PYTHON"] = sys.executable
        os.execv(program, ["citylearn", "encoder", "--encoder", file, *sys.argv[1:]])
    sides = list(size) if isinstance(size, (tuple, list)) else [size, size] if size is not None else []
    for name, value, most in [("batch", batch, MAX_BATCH), *(("size", side, MAX_SIDE) for side in sides),
                              ("dimension", 1 if dimension is None else dimension, MAX_DIMENSION)]:
        if type(value) is not int or not 1 <= value <= most:
            raise Fault(f"serve_encoder: {name} is {value!r}, not a whole number from 1 to {most}")
    if len(sides) not in (0, 2):
        raise Fault("serve_encoder: size is not (width, height)")
    if not callable(encode):
        raise Fault(f"serve_encoder: {encode!r} is not a function")
    if not re.fullmatch(r"[A-Za-z0-9._+-]{1,64}", str(version)):
        raise Fault(f"serve_encoder: version is {version!r}, not 1 to 64 letters, digits, dots and the like")
    dimension, seconds = trial(encode, dimension, sides, batch)
    _link.sendall(struct.pack("<5if108s", 0, dimension, *(sides or (0, 0)), batch, seconds, f"{version} {_hash}".encode()))
    while True:
        shape = struct.unpack("<3i", receive(12))
        pictures = numpy.frombuffer(receive(3 * shape[0] * shape[1] * shape[2]), numpy.uint8).reshape(*shape, 3)
        try:
            vectors = vectors_of(encode, pictures, dimension)
        except BaseException as error:
            report(error)
        else:
            _link.sendall(struct.pack("<i", 0))
            _link.sendall(vectors)


def end_with_program():
    """Ends this process when the program at the other end is gone, also while the function runs."""
    gone = select.poll()
    gone.register(_link, select.POLLRDHUP)
    gone.poll()
    os._exit(1)


def run(path):
    """Runs FILE.py as `python3 FILE.py` does, but for `import citylearn`: it finds this serve_encoder alone."""
    global _link, _path, _hash, numpy
    _link, _path = socket.socket(fileno=3), path
    # PyTorch's threads sleep while they wait for each other. As they come, they spin, on cores that others need.
    os.environ.setdefault("OMP_WAIT_POLICY", "passive")
    threading.Thread(target=end_with_program, daemon=True).start()
    try:
        import numpy  # before modules in the folder of FILE.py hide those that it needs
        with open(path, "rb") as file:
            source = file.read()
        _hash = hashlib.sha256(source).hexdigest()[:16]
        sys.modules["citylearn"] = types.ModuleType("citylearn")
        sys.modules["citylearn"].serve_encoder = serve_encoder
        sys.modules["__main__"] = main = types.ModuleType("__main__")
        main.__file__, sys.argv[:], sys.path[0] = path, [path], os.path.dirname(os.path.abspath(path))
        exec(compile(source, path, "exec"), main.__dict__)
        raise Fault("does not call citylearn.serve_encoder(encode, ...)")
    except BaseException as error:
        report(error)
    os._exit(1)


if __name__ == "__main__":
    run(sys.argv[1])
