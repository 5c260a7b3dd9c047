# Environment of the ROS prefix _mambo_prefix, a virtual environment with the Jazzy wheels.

_mambo_prepend() {  # variable value
    eval "_mambo_value=\${$1:-}"
    case ":$_mambo_value:" in
        *":$2:"*) ;;
        *) export "$1=$2${_mambo_value:+:$_mambo_value}" ;;
    esac
}

export VIRTUAL_ENV="$_mambo_prefix"
export ROS_DISTRO=jazzy ROS_VERSION=2 ROS_PYTHON_VERSION=3
# the wheels would start every Python twice to set LD_LIBRARY_PATH; with this they need not
export _ROS_WHEELS_BOOTSTRAP_COMPLETE=1
_mambo_prepend PATH "$_mambo_prefix/bin"
_mambo_prepend AMENT_PREFIX_PATH "$_mambo_prefix"
_mambo_prepend CMAKE_PREFIX_PATH "$_mambo_prefix"
_mambo_prepend LD_LIBRARY_PATH "$_mambo_prefix/lib"
for _mambo_libs in "$_mambo_prefix"/lib/python3*/site-packages/ros_*.libs; do
    _mambo_prepend LD_LIBRARY_PATH "$_mambo_libs"
done

unset -f _mambo_prepend
unset _mambo_prefix _mambo_value _mambo_libs
