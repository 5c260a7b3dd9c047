#!/usr/bin/env bash
# usage: tools/install.bash wheels|system
#
# Makes .venv hold what the workspace needs, and does nothing (in milliseconds) when it does:
#   wheels  ROS 2 Jazzy itself, colcon and the Python packages
#   system  only the Python packages, beside a ROS 2 Jazzy that is sourced
# env.bash decides which and calls this. All output goes to stderr; the details of an
# installation to .cache/install.log.
set -euo pipefail

mode=$1
root=$(cd -- "$(dirname -- "${BASH_SOURCE[0]}")/.." && pwd -P)
cd -- "$root"
venv=$root/.venv
log=$root/.cache/install.log
exec >&2

say() { printf 'mambo: %s\n' "$*"; }
fail() { say "$*"; exit 1; }
trap 'say "the installation was interrupted: start it again to go on"; exit 130' INT

# What .venv was made for (ROS, Python, folder) and the recipe that it was filled by.
base_stamp() {
    local version
    version=$("$venv/bin/python3" -V 2>/dev/null) || version='no Python'
    echo "$mode, ${version%.*}, $root"
}
stamp() {
    base_stamp
    cat requirements/*.txt requirements/lock/*.txt tools/install.bash tools/relocate_wheels.py \
        tools/local_setup.sh | cksum
}
up_to_date() { [[ -f $venv/.mambo && $(<"$venv/.mambo") == "$(stamp)" ]]; }

up_to_date && exit 0

# rosidl's CMake code cuts such a path at the first of these characters
is_ascii() { local LC_ALL=C; [[ $1 != *[!\ -~]* ]]; }
is_ascii "$root" ||
    fail "$root: ROS 2 interfaces cannot be built below a folder with characters other than ASCII: move the checkout"
if [[ -L $venv/bin/python3 && ! -x $venv/bin/python3 && ! -w $venv ]]; then
    fail "$root was installed with a Python that you may not run ($(readlink -m "$venv/bin/python3")): use a checkout of your own"
fi

# What belongs to another user is theirs to bring up to date.
for folder in . .cache .venv; do
    [[ ! -e $folder || -w $folder ]] ||
        fail "$root needs an installation, but $(realpath "$folder") belongs to $(stat -c %U "$folder"): let them source env.bash, or use a checkout of your own"
done

# One installation at a time; who had to wait finds it done.
mkdir -p .cache
exec 9>.cache/install.lock
if command -v flock >/dev/null; then
    flock -n 9 || { say 'waiting for an installation that is under way'; flock 9; }
    up_to_date && exit 0
fi

# ---- what only the machine can provide ----
missing=()
command -v g++ >/dev/null && command -v make >/dev/null || missing+=(build-essential)

# Prints why this Python cannot serve; nothing if it can.
python_problem() {
    "$1" - <<'PY' 2>/dev/null || echo "$1 does not run"
import os
import sys
import sysconfig
name = f'Python {sys.version_info[0]}.{sys.version_info[1]}'
if not (3, 10) <= sys.version_info[:2] <= (3, 13):
    print(f'{name} is outside 3.10 to 3.13')
    sys.exit()
try:
    import ensurepip  # noqa: F401
    import venv  # noqa: F401
except ImportError:
    print('missing python3-venv')
if not os.path.exists(os.path.join(sysconfig.get_path('include'), 'Python.h')):
    print('missing python3-dev')
PY
}

# An apt or RoboStack ROS has one Python, the python3 of its shell; the wheels serve several.
choose_python() {
    local candidate problem
    local candidates=(python3)
    [[ $mode == wheels ]] && candidates+=(python3.13 python3.12 python3.11 python3.10)
    python=
    for candidate in "${candidates[@]}"; do
        command -v "$candidate" >/dev/null || continue
        problem=$(python_problem "$candidate")
        [[ -z $problem ]] && { python=$candidate; return; }
        first_problem=${first_problem:-$problem}
    done
    while read -r word package; do
        [[ $word == missing ]] && missing+=("$package")
    done <<<"${first_problem:-}"
    [[ ${#missing[@]} -gt 0 ]] ||
        fail "needs Python 3.10 to 3.13 (${first_problem:-there is no python3}): sudo apt install python3 python3-venv python3-dev"
}

if [[ $mode == wheels && $(uname -sm) != 'Linux x86_64' ]]; then
    fail "there are ROS 2 wheels for Linux x86_64 only, not for $(uname -sm): install ROS 2 Jazzy (apt or RoboStack), source it, then come back"
fi
choose_python
[[ ${#missing[@]} -eq 0 ]] || fail "please install first: sudo apt install ${missing[*]}"
if [[ $mode == system ]]; then
    "$python" -c 'import rclpy' 2>/dev/null ||
        fail "ROS 2 Jazzy is sourced, but $(command -v "$python") cannot import rclpy: is its setup.bash the last thing sourced?"
    "$python" -c 'import tf2_msgs' 2>/dev/null || fail 'please install first: sudo apt install ros-jazzy-tf2-msgs'
fi

# ---- the virtual environment ----
if [[ -d $venv && ! -f $venv/.mambo ]]; then
    fail "$venv exists and is not this project's: move it away"
fi
made_for=$(head -n 1 "$venv/.mambo" 2>/dev/null) || true
if [[ $mode == wheels && $made_for == system,* ]]; then
    fail "$venv stands beside an installed ROS 2 that this shell has not sourced: source it, or remove .venv to use the wheels"
fi
first=yes
[[ $made_for != "$(base_stamp)" ]] || first=
case $mode${first:+ first} in
    'wheels first') say 'installing ROS 2 Jazzy and the Python packages into .venv (once, about 0.8 GB)' ;;
    'system first') say 'installing the Python packages into .venv, beside the ROS 2 of this machine' ;;
    *) say 'bringing .venv up to date' ;;
esac
if [[ $first ]]; then
    # build/ and install/ name the interpreter and this folder: they go with the old one. What
    # says that .venv is ours stays, lest an interruption make it somebody else's.
    if [[ -L $venv ]]; then rm "$venv"; fi
    mkdir -p "$venv"
    : >"$venv/.mambo"
    find "$venv" -mindepth 1 -maxdepth 1 ! -name .mambo -exec rm -rf {} +
    for folder in build install; do
        if [[ -f $folder/COLCON_IGNORE ]]; then rm -rf "$folder"; fi
    done
    options=()
    if [[ $mode == system ]]; then options+=(--system-site-packages); fi
    "$python" -m venv --without-pip "${options[@]}" "$venv" >"$log" 2>&1 ||
        fail "could not make $venv: see $log"
fi
base_stamp >"$venv/.mambo"  # not the whole stamp before all is done

# The pip that comes with Python runs from its wheel: venv would have all of it turned into byte
# code first, which takes longer than what it is used for here.
wheel=$("$python" - <<'PY'
import ensurepip
import os
import sysconfig
own = os.path.join(os.path.dirname(ensurepip.__file__), '_bundled')
for folder in filter(None, (sysconfig.get_config_var('WHEEL_PKG_DIR'), own)):
    for name in sorted(os.listdir(folder) if os.path.isdir(folder) else ()):
        if name.startswith('pip-') and name.endswith('.whl'):
            print(os.path.join(folder, name))
            raise SystemExit
PY
)
[[ $wheel ]] || fail "$python has no wheel of pip: sudo apt install python3-venv"

# without a home folder pip has no place for its cache, and trips over it
cache=()
[[ -d ${HOME:-} && -w $HOME ]] || cache=(--no-cache-dir)
pip() {
    env -u PYTHONPATH -u PYTHONHOME _ROS_WHEELS_BOOTSTRAP_COMPLETE=1 \
        "$venv/bin/python3" "$wheel/pip" install --disable-pip-version-check --prefer-binary \
        --no-compile --progress-bar off "${cache[@]}" "$@" >>"$log" 2>&1
}
# with a cache beside .venv uv can link its files, and the cache goes right after
uv() {
    local index=${UV_DEFAULT_INDEX:-${PIP_INDEX_URL:-}}
    env -u PYTHONPATH -u PYTHONHOME -u VIRTUAL_ENV _ROS_WHEELS_BOOTSTRAP_COMPLETE=1 \
        ${index:+"UV_DEFAULT_INDEX=$index"} \
        "$venv/bin/uv" --no-config pip install --no-progress --cache-dir .cache/uv \
        --python "$venv/bin/python3" "$@" >>"$log" 2>&1
    local code=$?
    rm -rf .cache/uv
    return "$code"
}

: >"$log"
if [[ $mode == wheels ]]; then  # exact versions, checked by their hashes
    version=$("$venv/bin/python3" -c 'import sys; print("%d.%d" % sys.version_info[:2])')
    # the lock is complete; without --no-deps pip refuses extras such as coverage[toml], which a
    # file with hashes cannot name
    requirements=(--require-hashes --no-deps -r "requirements/lock/python-$version.txt")
    command -v cmake >/dev/null || requirements+=(-r requirements/lock/cmake.txt)
else  # beside the versions of the system
    requirements=(-r requirements/python.txt -r requirements/test.txt)
    command -v colcon >/dev/null || requirements+=(-r requirements/colcon.txt)
    # ROS's message code was compiled against this numpy
    "$venv/bin/python3" -c 'import numpy; print(f"numpy=={numpy.__version__}")' \
        >.cache/constraints.txt
    requirements+=(-c .cache/constraints.txt)
fi
# beside a system pip decides what is there already
{ [[ $mode == wheels ]] && pip --require-hashes -r requirements/lock/uv.txt &&
    uv "${requirements[@]}"; } || pip "${requirements[@]}" || {
    grep -m 3 '^ERROR' "$log" || tail -n 3 "$log"
    fail "the installation did not finish (no network? full disk?): see $log, then try again"
}
[[ -x $venv/bin/pip ]] || { [[ -x $venv/bin/uv ]] && uv --no-deps "$wheel"; } ||
    pip --no-index --no-deps "$wheel" || fail "pip could not be installed: see $log"

# ---- the wheels become a ROS prefix like any other ----
if [[ $mode == wheels ]]; then
    # its local_setup, as in every ROS prefix: also what install/setup.bash sources beneath itself
    { printf "_mambo_prefix='%s'\n" "${venv//\'/\'\\\'\'}"; cat tools/local_setup.sh; } \
        >"$venv/local_setup.sh"
    for shell in bash zsh; do cp "$venv/local_setup.sh" "$venv/local_setup.$shell"; done
    # shellcheck disable=SC1091
    set +u; source "$venv/local_setup.sh"; set -u
    python3 tools/relocate_wheels.py
fi
command -v ros2 >/dev/null || ln -sf "$root/tools/ros2" "$venv/bin/ros2"
ln -sf "$root/tools/mambo" "$venv/bin/mambo"

# Byte code, for whoever may not write it, while the workspace is built; the lock stays until it
# is done. Left out: what no flight imports, most of the code. Ctrl-C during the build ends it.
later='plotly|pandas|pip|fontTools|dask|distributed|pygments|narwhals|tornado|hypothesis|trimesh'
later+='|docutils|_pytest|gymnasium|rich|imageio|viser|joblib|fsspec|apsw|jinja2|websockets|ruamel'
interruptible=(--default-signal=INT)  # GNU coreutils 8.31; without it, it runs to its end
env "${interruptible[@]}" true 2>/dev/null || interruptible=()
env "${interruptible[@]}" -u PYTHONPATH -u PYTHONHOME _ROS_WHEELS_BOOTSTRAP_COMPLETE=1 \
    nice "$venv/bin/python3" -m compileall -q -x "/tests/|/site-packages/($later|pyarrow)/" \
    "$venv"/lib/python3*/site-packages </dev/null >.cache/compileall.log 2>&1 &

stamp >"$venv/.mambo.new"
mv "$venv/.mambo.new" "$venv/.mambo"
say "installed in $SECONDS s"
