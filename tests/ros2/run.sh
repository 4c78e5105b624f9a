#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# run.sh SAMPLE ROS2 FOLDER: SAMPLE writes a recording, citylearn_ros2 converts it, readers of others read the result. Packages are
# kept in FOLDER.
here=$(cd "$(dirname "$0")" && pwd) || exit 1
# shellcheck source=../support/npm.sh
. "$here/../support/npm.sh"
npm_packages "$here" "$3"
cp "$here/read.mjs" .
rm -f ./*.mcap
"$1" sample.mcap || exit 1
said=$("$2" --open sample.mcap --output ros2.mcap --agents 2 --speed .5 2>&1) || { echo "$said"; exit 1; }
case $said in *'1 of 11 pictures are not in the recording'*) ;; *) echo "does not say which pictures are missing: $said"; exit 1 ;; esac
said=$("$2" --open sample.mcap --output none.mcap --session other 2>&1) && { echo "converts another session: $said"; exit 1; }
case $said in *"nothing of session 'other'"*) ;; *) echo "does not say that nothing was converted: $said"; exit 1 ;; esac
[ ! -e none.mcap ] || { echo 'leaves an empty file'; exit 1; }
exec node read.mjs ros2.mcap sample.mcap.json
