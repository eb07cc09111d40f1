# Shared by the other scripts, which source it: packages, configuration, build. Leaves the shell in the repository's root.
# shellcheck shell=bash disable=SC2034

cd "$(dirname "${BASH_SOURCE[0]}")/.." || exit
root=$PWD
build=$root/build/release
log=$root/build/setup.log
mkdir -p "$root/build"

build_packages=(g++ cmake ninja-build pkg-config libeigen3-dev libsuitesparse-dev libopenblas0-serial liburdfdom-dev nettle-dev
                libpugixml-dev libyaml-cpp-dev nlohmann-json3-dev libcli11-dev)
bag_packages=(libsqlite3-dev liblz4-dev libzstd-dev libbz2-dev zlib1g-dev)  # for kincal-bags, which is left out without them
python_packages=(python3-dev python3-numpy pybind11-dev)  # for the Python package, which is left out without them
image_packages=(libopencv-contrib-dev)  # for kincal-detect and kincal-render, which are left out without it
# Python: an independent implementation to compare with; mypy and pandas are for tests of the Python package.
test_packages=(catch2 python3-numpy python3-scipy python3-yaml python3-pandas mypy "${python_packages[@]}" "${image_packages[@]}" "${bag_packages[@]}")
arm64_packages=(g++-aarch64-linux-gnu qemu-user-static mmdebstrap)  # another processor's compiler, the processor, and its Debian; without them it is not tested
cluster_packages=(slurm-wlm munge)  # a Slurm that its tests start for themselves; without it they are skipped

fail() {
  printf '%s\n' "$@" >&2
  exit 1
}

# quietly WHAT COMMAND...: says WHAT, shows the command's output only if it fails.
quietly() {
  printf '%s ...\n' "$1"
  if ! "${@:2}" >"$log" 2>&1; then
    cat "$log" >&2
    fail "failed: $1 (${*:2})"
  fi
}

# need PACKAGE...: through apt, those that are missing. Where there is no dpkg, CMake says what it does not find.
need() {
  local missing=() package as_root=()
  if ! command -v dpkg-query >/dev/null; then
    echo "This is no Debian or Ubuntu, so nothing is installed. Needed are the equivalents of: $*" >&2
    return
  fi
  for package in "$@"; do
    [[ $(dpkg-query -W -f '${db:Status-Status}' "$package" 2>/dev/null) == installed ]] || missing+=("$package")
  done
  ((${#missing[@]})) || return 0

  local by_hand="To install them yourself, as root: apt-get install --no-install-recommends ${missing[*]}"
  command -v apt-get >/dev/null || fail "Missing packages: ${missing[*]}" "There is no apt-get here. $by_hand"
  if ((EUID != 0)); then
    command -v sudo >/dev/null || fail "Missing packages: ${missing[*]}" "Neither root nor sudo. $by_hand"
    as_root=(sudo)
  fi
  as_root+=(env DEBIAN_FRONTEND=noninteractive)
  echo "Missing packages: ${missing[*]}"
  # A list that cannot be fetched may not matter: the installation decides.
  (quietly "Installing" "${as_root[@]}" sh -c 'apt-get update; apt-get install -y --no-install-recommends "$@"' sh "${missing[@]}") ||
    fail "apt-get did not install what is missing (no network, or no right to?)." "$by_hand"
}

# configure ON|OFF: with or without tests. One build directory serves both: turning the tests on recompiles nothing, and
# a directory that has them keeps them, so that scripts/demo and scripts/test can follow each other in any order.
configure() {
  local tests=$1 had=
  [[ ! -f $build/build.ninja ]] || had=$(sed -n 's/^KINCAL_TESTS:[A-Z]*=//p' "$build/CMakeCache.txt")
  [[ $had != ON ]] || tests=ON
  # ninja itself runs CMake again when its files have changed; OpenCV and pybind11 may have been installed since.
  if [[ $had == "$tests" ]] && grep -q kincal-detect "$build/build.ninja" && { [[ $tests == OFF ]] || grep -q kincal_python "$build/build.ninja"; }; then
    return 0
  fi
  quietly "Configuring" cmake --preset release -DKINCAL_TESTS="$tests"
}

# make_target TARGET
make_target() {
  quietly "Building (the first time takes a few minutes)" cmake --build --preset release --target "$1" --parallel "$(nproc)"
}
