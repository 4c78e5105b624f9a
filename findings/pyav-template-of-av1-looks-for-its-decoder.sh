#!/bin/sh
# PyAV 18.1.0 (and 15.1.0): to copy an AV1 film without decoding, one adds a stream by the template of the film's own.
# That raises UnknownCodecError for 'libdav1d': it looks for an encoder with the name of the *decoder* in use, which for
# AV1 only decodes. H.264, whose decoder and format have one name, copies. With opaque=True AV1 copies too.
# Installs PyAV, makes a film of each kind of five frames, and copies their packets. Status 1: this has changed.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet av==18.1.0 numpy==2.4.6
"$folder/venv/bin/python" - "$folder" <<'END'
import sys
import av
import numpy as np

print("PyAV", av.__version__)


def make(path, codec):
    with av.open(path, "w") as film:
        stream = film.add_stream(codec, rate=10)
        stream.width, stream.height, stream.pix_fmt = 64, 64, "yuv420p"
        for level in range(5):
            picture = np.full((64, 64, 3), 40 * level, np.uint8)
            film.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="rgb24")))
        film.mux(stream.encode())


def copied(path, **options):
    """Returns how many packets a copy of the film has, or what was raised."""
    with av.open(path) as film, av.open(path + ".copy.mp4", "w") as copy:
        try:
            stream = copy.add_stream_from_template(film.streams.video[0], **options)
        except Exception as error:
            return f"{type(error).__name__}: {error}"
        count = 0
        for packet in film.demux(video=0):
            if packet.dts is not None:
                packet.stream = stream
                copy.mux(packet)
                count += 1
        return count


seen = []
for codec in ("libx264", "libsvtav1"):
    path = f"{sys.argv[1]}/{codec}.mp4"
    make(path, codec)
    with av.open(path) as film:
        decoder = film.streams.video[0].codec_context.codec.name
    seen.append((copied(path), copied(path, opaque=True)))
    print(codec, "read by", decoder, "-> by template:", seen[-1][0], "| opaque:", seen[-1][1])
(h264, h264_opaque), (av1, av1_opaque) = seen
sys.exit(not (h264 == h264_opaque == av1_opaque == 5 and "libdav1d" in str(av1)))
END
