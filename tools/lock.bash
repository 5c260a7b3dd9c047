#!/usr/bin/env bash
# usage: tools/lock.bash [--upgrade]
#
# Writes requirements/lock/: for each Python the exact version and the hashes of everything that
# the wheels of ROS 2, the workspace and its tests need. Versions stay as they are where the
# requirements still admit them, unless --upgrade is given. Runs in a shell of env.bash.
set -euo pipefail

cd -- "$(dirname -- "${BASH_SOURCE[0]}")/.."
lock() {  # output, options and requirements
    local output=requirements/lock/$1
    shift
    uv pip compile --quiet --generate-hashes --no-emit-index-url --no-header --no-annotate \
        --output-file "$output" "$@"
    echo "lock: $output, $(grep -c '^[a-z]' "$output") packages"
}

mkdir -p requirements/lock
lock uv.txt --universal "$@" requirements/uv.txt
lock cmake.txt --universal "$@" requirements/cmake.txt
for version in 3.10 3.11 3.12 3.13; do
    lock "python-$version.txt" --python-version "$version" --python-platform x86_64-manylinux_2_28 \
        "$@" requirements/{python,test,ros-jazzy,colcon}.txt
done
