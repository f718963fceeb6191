# shellcheck shell=bash
# Shared by scripts/*: sourced, never run. Installs what is missing, configures and builds.
# Environment: COCALIB_BUILD_DIR (default build/), COCALIB_JOBS (compilers at once), COCALIB_SKIP_INSTALL=1.
set -euo pipefail
repo=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
# shellcheck source=scripts/progress.sh
source "$repo/scripts/progress.sh"
build_dir=${COCALIB_BUILD_DIR:-$repo/build}
noetic_setup=/opt/ros/noetic/setup.bash
cmake_options=()  # of a build of another kind
# A pyenv or conda python3 in front of the system's one has no ROS modules and breaks message generation.
export PATH=/usr/bin:$PATH

# Debian 12 (and 11) package ROS 1 themselves.
debian_packages=(
  build-essential cmake catkin ccache
  ros-message-generation ros-std-msgs ros-geometry-msgs ros-sensor-msgs ros-visualization-msgs ros-diagnostic-msgs ros-std-srvs
  libcv-bridge-dev libdiagnostic-updater-dev libdynamic-reconfigure-config-init-mutex-dev libimage-transport-dev libnodelet-dev libnodeletlib-dev librosbag-dev libroscpp-dev libstd-srvs-dev
  libtf2-ros-dev libvisualization-msgs-dev pluginlib-dev python3-dynamic-reconfigure
  libboost-program-options-dev libceres-dev libeigen3-dev libopencv-dev libyaml-cpp-dev
  libnodeletlib-tools rosbash rosout python3-nodelet python3-roslaunch python3-rosbag python3-rosnode python3-rosparam
  python3-rosservice python3-rostopic python3-rosmsg python3-geometry-msgs python3-sensor-msgs python3-visualization-msgs
  python3-diagnostic-msgs python3-std-srvs
  python3-numpy python3-yaml
  librostest-dev python3-rostest libgtest-dev)
debian_rviz_packages=(rviz)
# Ubuntu 20.04 with ROS Noetic: the same by their names there.
noetic_packages=(
  build-essential cmake ccache
  ros-noetic-catkin ros-noetic-cv-bridge ros-noetic-diagnostic-updater ros-noetic-dynamic-reconfigure ros-noetic-geometry-msgs
  ros-noetic-image-transport ros-noetic-message-generation ros-noetic-message-runtime ros-noetic-nodelet ros-noetic-pluginlib
  ros-noetic-rosbag ros-noetic-rosbash ros-noetic-roscpp ros-noetic-roslaunch ros-noetic-rostest ros-noetic-rosunit
  ros-noetic-sensor-msgs ros-noetic-std-msgs ros-noetic-std-srvs ros-noetic-tf2-msgs ros-noetic-tf2-ros ros-noetic-visualization-msgs
  libboost-program-options-dev libceres-dev libeigen3-dev libopencv-dev libyaml-cpp-dev libgtest-dev
  python3-numpy python3-yaml)
noetic_rviz_packages=(ros-noetic-rviz)

say() { printf '== %s\n' "$*"; }
die() { printf '%s: %s\n' "$(basename "$0")" "$*" >&2; exit 1; }

# Sources a ROS setup file, which is safe neither under set -u nor under set -e.
source_setup() {
  set +eu
  # shellcheck disable=SC1090
  source "$1"
  set -eu
}

# apt-get as root: directly, or by sudo (which may ask for the password, but never where nobody can answer).
as_root() {
  if [ "$(id -u)" = 0 ]; then
    env DEBIAN_FRONTEND=noninteractive "$@"
  elif [ -t 0 ]; then
    sudo env DEBIAN_FRONTEND=noninteractive "$@"
  else
    sudo -n env DEBIAN_FRONTEND=noninteractive "$@"
  fi
}

# install_missing PACKAGE...: apt-get install of those that dpkg does not know as installed.
install_missing() {
  local missing=() package log="$build_dir/install.log"
  for package in "$@"; do
    [ "$(dpkg-query -W -f='${db:Status-Status}' "$package" 2>/dev/null)" = installed ] || missing+=("$package")
  done
  [ ${#missing[@]} = 0 ] && return 0
  if [ "$(id -u)" != 0 ]; then
    command -v sudo >/dev/null || die "packages are missing; run as root: apt-get install --no-install-recommends ${missing[*]}"
    say "these packages are missing and will be installed with sudo: ${missing[*]}"
  fi
  say "installing ${#missing[@]} packages and what they need (a few minutes; log: $log)"
  mkdir -p "$build_dir"
  local apt=(apt-get -o DPkg::Lock::Timeout=600 -o Acquire::Retries=3 -o APT::Status-Fd=1)
  if ! { as_root "${apt[@]}" update && as_root "${apt[@]}" install -y --no-install-recommends "${missing[@]}"; } 2>&1 |
      tee "$log" | { grep --line-buffered -E '^(dl|pm)status:' || true; } | show_progress; then
    tail -n 20 "$log" >&2
    die "installing packages failed; install them by hand and run again: ${missing[*]}"
  fi
}

# setup [--rviz]: everything that building and running need is installed, and ROS is on the paths.
setup() {
  local id version packages rviz_packages
  # shellcheck disable=SC1091
  id=$(. /etc/os-release && echo "${ID:-}") version=$(. /etc/os-release && echo "${VERSION_ID:-}")
  case "$id $version" in
    "debian 12" | "debian 11")
      packages=("${debian_packages[@]}") rviz_packages=("${debian_rviz_packages[@]}") ;;
    "ubuntu 20.04")
      [ -e "$noetic_setup" ] || die "ROS Noetic is not installed: see http://wiki.ros.org/noetic/Installation/Ubuntu, then run again"
      packages=("${noetic_packages[@]}") rviz_packages=("${noetic_rviz_packages[@]}") ;;
    *)
      [ -n "${COCALIB_SKIP_INSTALL:-}" ] || die "made for Debian 12 and for Ubuntu 20.04 with ROS Noetic, this is '$id $version';" \
        "install what package.xml names yourself and set COCALIB_SKIP_INSTALL=1" ;;
  esac
  if [ -z "${COCALIB_SKIP_INSTALL:-}" ]; then
    [ "${1:-}" = --rviz ] && packages+=("${rviz_packages[@]}")
    install_missing "${packages[@]}"
  fi
  if [ -e "$noetic_setup" ]; then source_setup "$noetic_setup"; fi
}

# Compilers at once: one a core, but each may need 1.7 GB.
compile_jobs() {
  local cores memory
  cores=$(nproc)
  memory=$(awk '/^MemAvailable:/ {print int($2 / 1.7e6)}' /proc/meminfo)
  [ "$memory" -lt "$cores" ] && cores=$memory
  [ "$cores" -ge 1 ] || cores=1
  echo "${COCALIB_JOBS:-$cores}"
}

# build TARGET...: configures, with cmake_options, and makes; shows how far it is and everything that is not progress
# (warnings, errors).
build() {
  local launcher=() log="$build_dir/build.log" devel="${build_dir}_devel"
  mkdir -p "$build_dir" "$devel"
  # rosrun passes over every program below the package's own build/, so the devel space stands beside it and is linked in.
  [ -L "$build_dir/devel" ] || rm -rf "$build_dir/devel"
  ln -sfn "$devel" "$build_dir/devel"
  command -v ccache >/dev/null && launcher=(-DCMAKE_CXX_COMPILER_LAUNCHER=ccache)
  say "configuring (log: $build_dir/configure.log)"
  if ! cmake -S "$repo" -B "$build_dir" -DCATKIN_DEVEL_PREFIX="$devel" "${launcher[@]}" "${cmake_options[@]}" >"$build_dir/configure.log" 2>&1; then
    tail -n 30 "$build_dir/configure.log" >&2
    die "configuring failed"
  fi
  say "building $* with $(compile_jobs) jobs (log: $log)"
  : >"$log"
  local target
  for target in "$@"; do
    make -C "$build_dir" --no-print-directory -j"$(compile_jobs)" "$target" 2>&1 | tee -a "$log" |
      show_progress "building $target" || die "building failed"
  done
}
