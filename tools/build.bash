#!/usr/bin/env bash
# usage: tools/build.bash [flight]
#
# Builds the workspace if anything that a build looks at is newer than the last one: package.xml,
# setup.py, CMake and message files, and the set of launch, parameter and scenario files. Python
# modules are linked, not copied, so editing them needs no build. Runs in a shell of env.bash.
#
#   flight  before the first build, only what a flight in one process needs: the messages, and
#           links to the Python packages where colcon puts them; env.bash puts them on PYTHONPATH
set -euo pipefail

root=$(cd -- "$(dirname -- "${BASH_SOURCE[0]}")/.." && pwd -P)
cd -- "$root"

# True if every package was built, successfully, after its last change. colcon leaves the result
# of each package in a file, so a build by hand counts too.
up_to_date() {
    local manifest package result oldest=
    for manifest in src/*/package.xml; do
        package=${manifest#src/}; package=${package%/package.xml}
        result=build/$package/colcon_build.rc
        [[ -f $result && $(<"$result") == 0 ]] || return 1
        [[ -n $oldest && ! $result -ot $oldest ]] || oldest=$result
    done
    [[ -f install/local_setup.bash ]] || return 1
    messages_up_to_date || return 1
    [[ -z $(find src colcon.meta -newer "$oldest" -not -path '*/__pycache__*' \( \
        -name package.xml -o -name 'setup.*' -o -name CMakeLists.txt -o -name '*.msg' \
        -o -name colcon.meta -o -type d \( -name launch -o -name config -o -name layouts \
        -o -name scenarios \) \) -print -quit) ]]
}

# Of the messages that the nodes use, tf2_msgs alone has no wheel.
messages_up_to_date() {
    [[ ${MAMBO_ROS:-} != wheels ]] || [[ $(cat .venv/share/tf2_msgs/made_of 2>/dev/null) == \
        "$(cksum compat/tf2_msgs/*.* compat/tf2_msgs/msg/*)" ]]
}
build_messages() {
    rm -rf .cache/tf2_msgs
    cmake -S compat/tf2_msgs -B .cache/tf2_msgs -DCMAKE_INSTALL_PREFIX="$root/.venv" \
        -DCMAKE_BUILD_TYPE=Release &&
        cmake --build .cache/tf2_msgs --target install &&
        cksum compat/tf2_msgs/*.* compat/tf2_msgs/msg/* >.venv/share/tf2_msgs/made_of
}

# True before any Python package was built.
is_first() {
    local script
    for script in src/*/setup.py; do
        script=${script#src/}
        [[ ! -f build/${script%/setup.py}/colcon_build.rc ]] || return 1
    done
}
# Makes the links that colcon makes with --symlink-install, at the same place: compiled code is
# found by the path of its source.
link_packages() {
    local package
    for package in src/*/setup.py; do
        package=${package#src/}; package=${package%/setup.py}
        [[ -e build/$package/$package ]] || {
            mkdir -p "build/$package"
            ln -sfn "$root/src/$package/$package" "build/$package/$package"
        }
    done
}
messages_built() {
    local result=build/mambo_interfaces/colcon_build.rc
    [[ -f $result && $(<"$result") == 0 && -f install/local_setup.bash ]] &&
        messages_up_to_date &&
        [[ -z $(find src/mambo_interfaces colcon.meta -newer "$result" -type f -print -quit) ]]
}
flight_ready() { messages_built && link_packages; }

# setuptools quotes an interpreter whose path has a space, which no kernel understands.
mend_interpreters() {
    [[ $root == *' '* && -d install ]] || return 0
    local file
    for file in install/*/lib/mambo_*/*; do
        if [[ $(head -c 3 "$file" 2>/dev/null) == '#!"' ]]; then
            sed -i '1s|.*|#!/usr/bin/env python3|' "$file"
        fi
    done
}

mend_interpreters
up_to_date && exit 0
part=
if [[ ${1:-} == flight ]] && is_first; then
    part=flight
    if flight_ready; then exit 0; fi
fi
for folder in . .cache build install log; do
    [[ ! -e $folder || -w $folder ]] || {
        echo "mambo: $root needs a build, but $root/$folder belongs to" \
            "$(stat -c %U "$folder"): let them source env.bash, or use a checkout of your own" >&2
        exit 1
    }
done
mkdir -p .cache
exec 9>.cache/build.lock
if command -v flock >/dev/null; then
    flock -n 9 || { echo 'mambo: waiting for a build that is under way' >&2; flock 9; }
    up_to_date && exit 0
    if [[ $part ]] && flight_ready; then exit 0; fi
fi

echo 'mambo: building the workspace' >&2
log=.cache/build.log
# colcon's own options limit make by the load of the last minute, which an installation has just
# raised: the interfaces would compile on one core
export MAKEFLAGS=${MAKEFLAGS:--j$(nproc)}
building=
if ! messages_up_to_date; then  # on the core that colcon leaves idle for a while
    build_messages >.cache/tf2_msgs.log 2>&1 &
    building=$!
fi
chosen=()
if [[ $part ]]; then
    chosen=(--packages-select mambo_interfaces)
    link_packages
fi
interrupted=
trap 'interrupted=yes' INT
colcon build --event-handlers console_direct- console_cohesion+ "${chosen[@]}" >"$log" 2>&1 || {
    [[ -z $building ]] || wait "$building" || true
    if [[ $interrupted ]]; then
        echo 'mambo: the build was interrupted: start it again to go on' >&2
        exit 130
    fi
    sed -n '/^--- stderr/,/^---$/p' "$log" | head -n 40 >&2 || true  # SIGPIPE
    echo "mambo: the build failed: see $root/$log" >&2
    exit 1
}
[[ -z $building ]] || wait "$building" || {
    echo "mambo: could not build compat/tf2_msgs: see $root/.cache/tf2_msgs.log" >&2
    exit 1
}
mend_interpreters
later='; the first flight compiles for about a minute'
if compgen -G '.cache/numba-*' >/dev/null; then later=; fi
echo "mambo: built in $SECONDS s$later" >&2
