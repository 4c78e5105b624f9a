#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# run.sh SAMPLE FOLDER: the program SAMPLE exports an agent, ONNX Runtime runs it. Packages are kept in FOLDER.
here=$(cd "$(dirname "$0")" && pwd) || exit 1
# shellcheck source=../support/npm.sh
. "$here/../support/npm.sh"
npm_packages "$here" "$2"
cp "$here/run.mjs" .
rm -rf patchnorm onnx && "$1" . && node run.mjs patchnorm && node run.mjs onnx
