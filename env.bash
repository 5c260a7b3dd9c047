# Source this in bash: a shell with ROS 2 Jazzy, colcon, the Python packages and this workspace.
#
#   source env.bash
#
# Takes the ROS 2 Jazzy that is sourced already, else the one in /opt/ros/jazzy, else Jazzy's
# wheels; Python packages go to .venv in this folder, compiled numerics and logs to .cache, nothing
# to the home folder (of another user's checkout, the cache goes to one's own). Installs and builds what is missing or out of date, and says so; otherwise
# it is silent and quick.

# shellcheck disable=SC1091
if [ -z "${BASH_VERSION:-}" ] || [ "${BASH_SOURCE:-}" = "$0" ]; then
    echo 'mambo: this file is for bash, to be sourced: source env.bash' >&2
    # shellcheck disable=SC2317
    return 1 2>/dev/null || exit 1
fi

# Takes the entries below a folder out of a search path.
_mambo_forget() {  # variable folder
    local entry kept='' IFS=:
    for entry in ${!1:-}; do
        [[ $entry == "$2"/* || -z $entry ]] || kept+=${kept:+:}$entry
    done
    if [[ -n $kept ]]; then export "$1=$kept"; else unset "$1"; fi
}

# Chooses the ROS 2 beneath the workspace: sets MAMBO_ROS to wheels or system.
_mambo_choose() {
    if [[ -z ${ROS_DISTRO:-} && -f /opt/ros/jazzy/setup.bash ]]; then
        source /opt/ros/jazzy/setup.bash
    fi
    case ${ROS_DISTRO:-} in
        jazzy) MAMBO_ROS=system ;;
        '') MAMBO_ROS=wheels ;;
        *)
            echo "mambo: this shell has ROS 2 $ROS_DISTRO, the workspace needs jazzy:" \
                'start from a shell without it' >&2
            return 1 ;;
    esac
    export MAMBO_ROS
}

_mambo_enter() {
    local - variable
    set +eu +f
    local root
    root=$(cd -- "$(dirname -- "${BASH_SOURCE[0]}")" && pwd -P)

    # leave what an earlier source (of this or another checkout) put here
    if [[ -n ${MAMBO_ROOT:-} ]]; then
        for variable in PATH PYTHONPATH LD_LIBRARY_PATH AMENT_PREFIX_PATH CMAKE_PREFIX_PATH \
            COLCON_PREFIX_PATH PKG_CONFIG_PATH; do
            _mambo_forget "$variable" "$MAMBO_ROOT"
        done
        [[ ${PYTHONPYCACHEPREFIX:-} != "$MAMBO_ROOT"/* ]] || export PYTHONDONTWRITEBYTECODE=1
        for variable in MAMBO_CACHE_DIR COLCON_DEFAULTS_FILE MPLCONFIGDIR ROS_LOG_DIR \
            FASTRTPS_DEFAULT_PROFILES_FILE PYTHONPYCACHEPREFIX; do
            [[ ${!variable:-} != "$MAMBO_ROOT"/* ]] || unset "$variable"
        done
        [[ ${MAMBO_ROS:-} != wheels ]] || unset ROS_DISTRO ROS_VERSION ROS_PYTHON_VERSION
        unset MAMBO_ROOT MAMBO_ROS _ROS_WHEELS_BOOTSTRAP_COMPLETE
    fi
    unset PYTHONHOME

    _mambo_choose || return
    export MAMBO_ROOT=$root
    local cache=$root/.cache
    mkdir -p -- "$cache" 2>/dev/null
    if [[ ! -w $cache ]]; then  # another user's checkout: a cache of one's own
        cache=${XDG_CACHE_HOME:-${HOME:-/tmp}/.cache}/mambo
        mkdir -p -- "$cache" 2>/dev/null || {
            cache=${TMPDIR:-/tmp}/mambo-$(id -u)
            mkdir -p -m 700 -- "$cache" 2>/dev/null && [[ -O $cache ]]
        } || {
            echo 'mambo: no folder for compiled code can be made: set XDG_CACHE_HOME to one' >&2
            return 1
        }
    fi
    export MAMBO_CACHE_DIR=${MAMBO_CACHE_DIR:-$cache}
    # Containers often forbid bytecode beside its sources. Without any, every command compiles
    # numpy, pandas and all else that it imports again: it goes to the cache then.
    if [[ -n ${PYTHONDONTWRITEBYTECODE:-} ]]; then
        export PYTHONPYCACHEPREFIX=${PYTHONPYCACHEPREFIX:-$cache/bytecode}
        unset PYTHONDONTWRITEBYTECODE
    fi
    # Python takes a file that a limit cut off for whole, and reads the cut byte code ever after
    [[ $(ulimit -f) == unlimited ]] || export PYTHONDONTWRITEBYTECODE=1
    "$root/tools/install.bash" "$MAMBO_ROS" || return
    export MPLCONFIGDIR=${MPLCONFIGDIR:-$cache/matplotlib}
    export ROS_LOG_DIR=${ROS_LOG_DIR:-$cache/ros-log}
    export COLCON_DEFAULTS_FILE=${COLCON_DEFAULTS_FILE:-$root/tools/colcon-defaults.yaml}
    # this machine only, unless asked otherwise: docs/how-to/network.md
    export ROS_AUTOMATIC_DISCOVERY_RANGE=${ROS_AUTOMATIC_DISCOVERY_RANGE:-LOCALHOST}
    if [[ $ROS_AUTOMATIC_DISCOVERY_RANGE == LOCALHOST && -z ${ROS_STATIC_PEERS:-} ]]; then
        local profiles=$root/src/mambo_ros/mambo_ros/fastdds_loopback.xml
        export FASTRTPS_DEFAULT_PROFILES_FILE=${FASTRTPS_DEFAULT_PROFILES_FILE:-$profiles}
    fi
    if [[ $MAMBO_ROS == wheels ]]; then
        source "$root/.venv/local_setup.bash"
    else
        local packages=("$root"/.venv/lib/python3*/site-packages)
        export VIRTUAL_ENV=$root/.venv PATH=$root/.venv/bin:$PATH
        # for the programs of ROS that start with /usr/bin/python3
        export PYTHONPATH=${PYTHONPATH:+$PYTHONPATH:}${packages[0]}
    fi

    "$root/tools/build.bash" ${_mambo_part:+"$_mambo_part"} || return
    # colcon's scripts start Python by an unquoted path: give them one without a space
    COLCON_PYTHON_EXECUTABLE=$(readlink -f "$root/.venv/bin/python3") \
        source "$root/install/local_setup.bash"
    if [[ ${_mambo_part:-} == flight ]]; then  # packages that are only linked so far
        local script package
        for script in "$root"/src/*/setup.py; do
            package=${script#"$root/src/"}; package=$root/build/${package%/setup.py}
            [[ -f $package/colcon_build.rc ]] ||
                export PYTHONPATH=${PYTHONPATH:+$PYTHONPATH:}$package
        done
    fi
}

_mambo_enter
_mambo_status=$?
if [[ $- == *i* ]]; then  # completion of the command mambo by the tab key
    __mambo_complete() {
        local IFS=$'\013'
        # shellcheck disable=SC2207
        COMPREPLY=($(IFS=$IFS COMP_LINE=$COMP_LINE COMP_POINT=$COMP_POINT COMP_TYPE=$COMP_TYPE \
            _ARGCOMPLETE_COMP_WORDBREAKS=$COMP_WORDBREAKS _ARGCOMPLETE=1 _ARGCOMPLETE_SHELL=bash \
            "$1" 8>&1 9>&2 >/dev/null 2>&1))
    }
    complete -o nospace -o default -o bashdefault -F __mambo_complete mambo ./mambo
fi
unset -f _mambo_forget _mambo_choose _mambo_enter
eval "unset _mambo_status _mambo_part; return $_mambo_status"
