# shellcheck shell=bash disable=SC2034
# Shared by ./run and ./test: a compiler, a Python, a virtual environment with pieper in it. Sourced, not run.
#
# Everything is made once and kept in .venv and build/; a second call finds nothing to do and takes about a second.
#
#   PYTHON=/path/to/python3.12   the Python to use (otherwise the first suitable one on PATH)

set -euo pipefail
caller=$PWD
cd "$(dirname "${BASH_SOURCE[0]}")/.."
root=$PWD
venv=$root/.venv
python=$venv/bin/python
logs=$root/build/logs
export PIP_DISABLE_PIP_VERSION_CHECK=1
unset PYTHONPATH PYTHONHOME PIP_REQUIRE_VIRTUALENV 2>/dev/null || true

say() { printf '%s\n' "$*" >&2; }
die() { say "error: $*"; exit 1; }

# step "what is being done" COMMAND...: run it quietly, show the seconds as they pass, show its last lines if it fails.
step() {
  local title=$1 log start=$SECONDS status=0 shown=0
  shift
  mkdir -p "$logs"
  log=$logs/$(printf '%s' "$title" | tr -cs 'A-Za-z0-9' '_').log
  [ -t 2 ] || say "-- $title"
  "$@" >"$log" 2>&1 </dev/null &
  local child=$!
  trap 'kill "$child" 2>/dev/null; wait "$child" 2>/dev/null; exit 130' INT TERM
  while kill -0 "$child" 2>/dev/null; do
    if [ -t 2 ]; then
      printf '\r-- %s ... %d s ' "$title" $((SECONDS - start)) >&2
    elif [ $((SECONDS - start)) -ge $((shown + 20)) ]; then
      shown=$((SECONDS - start))
      say "   ... $shown s"
    fi
    sleep 0.2
  done
  wait "$child" || status=$?
  trap - INT TERM
  if [ -t 2 ]; then printf '\r-- %s: %d s    \n' "$title" $((SECONDS - start)) >&2; fi
  if [ "$status" -ne 0 ]; then
    tail -n 40 "$log" >&2
    say "error: '$title' failed (exit $status); the whole log is $log"
    exit "$status"
  fi
}

# install_debian PURPOSE PACKAGE...: from Debian's own archive, as root or through sudo.
install_debian() {
  local purpose=$1 sudo=''
  shift
  command -v apt-get >/dev/null || die "$purpose missing; install it with your system's package manager ($*) and try again"
  if [ "$(id -u)" -ne 0 ]; then
    command -v sudo >/dev/null && sudo -n true 2>/dev/null || die "$purpose missing; run: sudo apt-get install $*"
    sudo='sudo -n'
  fi
  # shellcheck disable=SC2086
  {
    [ -n "${lists_are_new:-}" ] || step "asking Debian for its package lists" $sudo apt-get update
    lists_are_new=yes
    step "installing $*" $sudo env DEBIAN_FRONTEND=noninteractive apt-get install -y --no-install-recommends "$@"
  }
}

compiles_cxx20() {
  command -v "$1" >/dev/null && printf '#include <concepts>\n#include <bit>\nint main() { return std::popcount(1u) - 1; }\n' |
    "$1" -std=c++20 -x c++ - -o /dev/null 2>/dev/null
}

ensure_compiler() {
  local candidate
  for candidate in ${CXX:-} c++ g++ clang++; do
    if compiles_cxx20 "$candidate"; then export CXX=$candidate; return; fi
  done
  [ -z "${CXX:-}" ] || die "CXX=$CXX does not compile C++20"
  install_debian "a C++20 compiler is" g++ libc6-dev
  export CXX=g++
  compiles_cxx20 "$CXX" || die "$($CXX --version | head -n 1) does not compile C++20; set CXX to one that does (g++ 11, clang 14 or later)"
}

# Fast DDS, the foreign peer of the ROS tests. They say so and skip where it cannot be had; it is asked for once.
ensure_fast_dds() {
  local given_up=$root/build/without-fast-dds
  if [ -e /usr/include/fastrtps/fastrtps_all.h ] || [ -e "$given_up" ]; then return; fi
  ( install_debian "Fast DDS is" libfastrtps-dev ) || {
    mkdir -p "$root/build"
    touch "$given_up"
    say "   the tests against Fast DDS will be skipped; to try again, remove build/without-fast-dds"
  }
}

# OpenGL without a screen, for films and the tests that draw pictures; after ensure_package. These skip where it cannot be had.
ensure_gl() {
  local given_up=$root/build/without-gl
  if [ "$(uname -s)" != Linux ] || [ -e "$given_up" ] || draws_without_a_screen; then return; fi
  ( install_debian "OpenGL that draws without a screen is" libegl1 libopengl0 libgl1-mesa-dri ) && draws_without_a_screen || {
    mkdir -p "$root/build"
    touch "$given_up"
    say "   nothing can be drawn, and the tests that do will be skipped; to try again, remove build/without-gl"
  }
}

# A browser for the tests of the viewer, which say so and skip where there is none; it is asked for once.
ensure_chromium() {
  local given_up=$root/build/without-chromium
  if command -v chromium chromium-browser google-chrome >/dev/null || [ -e "$given_up" ]; then return; fi
  ( [ "$(uname -s)" = Linux ] && install_debian "Chromium is" chromium fonts-dejavu-core ) || {
    mkdir -p "$root/build"
    touch "$given_up"
    say "   the tests in a browser will be skipped; to try again, remove build/without-chromium"
  }
}

draws_without_a_screen() {
  "$python" -c 'from pieper.sim import offscreen; offscreen.gl_context(16, 16).free()' >/dev/null 2>&1
}

# python_has FEATURE CANDIDATE: version (3.10 or later), venv (can make environments), headers (Python.h is there).
python_has() {
  "$2" - "$1" <<'PY' 2>/dev/null
import os, sys, sysconfig
wanted = sys.argv[1]
fine = sys.version_info >= (3, 10)
if wanted == "venv":
    import ensurepip, venv
if wanted == "headers":
    fine = fine and os.path.exists(os.path.join(sysconfig.get_path("include"), "Python.h"))
sys.exit(not fine)
PY
}

# Sets $base_python to a Python that can make the environment and compile against itself.
ensure_python() {
  local candidate path
  base_python=''
  for candidate in ${PYTHON:-python3 python3.14 python3.13 python3.12 python3.11 python3.10 /usr/bin/python3}; do
    path=$(command -v "$candidate") || continue
    python_has version "$path" || continue
    base_python=${base_python:-$path}
    if python_has venv "$path" && python_has headers "$path"; then base_python=$path; return; fi
  done
  [ -n "$base_python" ] || {
    [ -z "${PYTHON:-}" ] || die "PYTHON=$PYTHON is not a Python 3.10 or later"
    install_debian "Python 3.10 or later is" python3 python3-venv python3-dev
    base_python=/usr/bin/python3
    python_has version "$base_python" || die "this system's Python is older than 3.10; set PYTHON to a newer one"
    return
  }
  local version
  version=$("$base_python" -c 'import sys; print("python%d.%d" % sys.version_info[:2])')
  # Of Debian's own Python the missing halves come from Debian; another one has to bring its own.
  case $("$base_python" -c 'import sys; print(sys.base_prefix)') in
    /usr) install_debian "the headers or the venv module of $version are" "$version-dev" "$version-venv" ;;
    *) die "$base_python lacks the venv module or Python.h; install its development files, or set PYTHON" ;;
  esac
}

venv_is_sound() {
  [ -x "$python" ] && python_has version "$python" && python_has headers "$python" &&
    [ "$("$python" -c 'import sys, pip; print(sys.prefix)' 2>/dev/null)" = "$venv" ] &&
    [[ $(head -n 2 "$venv/bin/pip" 2>/dev/null) == *"$venv/bin/python"* ]] || return 1 # not moved since
  [ -z "${PYTHON:-}" ] || [ "$("$python" -c "$identity")" = "$("$PYTHON" -c "$identity")" ]
}
identity='import sys; print(sys.version, sys.base_prefix)'

ensure_venv() {
  if venv_is_sound; then return; fi
  ensure_python
  rm -rf "$venv"
  step "making a virtual environment with $("$base_python" --version)" "$base_python" -m venv "$venv"
  step "updating pip" "$python" -m pip install --upgrade 'pip>=25.1'
}

# A fingerprint of everything that a wheel is built from; what a build leaves behind does not count.
sources_fingerprint() {
  {
    find src native ros2 \( -name CMakeFiles -o -name __pycache__ \) -prune -o -type f ! -name '*.so' ! -name '*.a' ! -name '*.cmake' -print0
    printf '%s\0' CMakeLists.txt pyproject.toml README.md LICENSE
  } | LC_ALL=C sort -z | xargs -0 sha256sum | sha256sum | cut -c 1-64
}

# once STAMP FINGERPRINT TITLE COMMAND...: run the step unless it was last run with the same fingerprint.
once() {
  local stamp=$venv/.pieper-$1 fingerprint=$2
  shift 2
  if [ "$(cat "$stamp" 2>/dev/null)" = "$fingerprint" ]; then return; fi
  step "$@"
  printf '%s\n' "$fingerprint" >"$stamp"
}

# ensure_package GROUP...: pieper itself, and the named dependency groups of pyproject.toml.
ensure_package() {
  local groups="build${*:+ $*}" group arguments=() fingerprint
  ensure_venv
  for group in $groups; do arguments+=(--group "$group"); done
  fingerprint=$(sources_fingerprint)
  if [ "$(cat "$venv/.pieper-package" 2>/dev/null)" != "$fingerprint" ]; then ensure_compiler; fi
  once "groups-${groups// /-}" "$(sha256sum <pyproject.toml)" "installing tools ($groups)" \
    "$python" -m pip install "${arguments[@]}"
  once package "$fingerprint" "compiling and installing pieper" \
    env PATH="$venv/bin:$PATH" "$python" -m pip install --no-build-isolation .
}

# ensure_extras EXTRA...: what those extras of pieper bring, after ensure_package.
ensure_extras() {
  local extras
  extras=$(IFS=,; printf '%s' "$*")
  once "extras-${extras//,/-}" "$(sha256sum <pyproject.toml)" "installing what this needs ($extras)" \
    "$python" -m pip install "pieper[$extras]"
}

# A tool that tests compare with, after ensure_package. It asks for opencv-python, which would overwrite opencv-python-headless; what
# is used of it, its figures, needs NumPy and SciPy alone. The tests say so and skip where it cannot be had.
ensure_trackeval() {
  ( once trackeval trackeval-1.3.0 "installing trackeval" "$python" -m pip install --no-deps trackeval==1.3.0 ) ||
    say "   the tests against trackeval will be skipped"
}

# Builds and runs the tests of the C++ library, which need no Python; cmake and ninja are those on PATH.
native_tests() {
  ensure_compiler
  step "configuring the native tests" cmake -S . -B build/native-tests -G Ninja -DCMAKE_BUILD_TYPE=Release
  step "compiling the native tests" cmake --build build/native-tests
  ctest --test-dir build/native-tests/native --output-on-failure
}

# The same tests on the portable path, as a compiler without vector types has it, to the letter of the standard; with Clang where there is one, to hear a
# second compiler.
portable_tests() {
  ensure_compiler
  local compiler=$CXX
  ! compiles_cxx20 clang++ || compiler=clang++
  step "configuring the portable tests ($compiler)" env CXX="$compiler" cmake -S . -B "build/portable-tests-$compiler" -G Ninja -DCMAKE_BUILD_TYPE=Release -DPIEPER_PORTABLE=ON -DCMAKE_CXX_FLAGS=-pedantic-errors
  step "compiling the portable tests" cmake --build "build/portable-tests-$compiler"
  ctest --test-dir "build/portable-tests-$compiler/native" --output-on-failure
}

# The same tests for another processor or another system, compiled here and emulated: foreign_tests SYSTEM PROCESSOR COMPILER EMULATOR.
foreign_tests() {
  local system=$1 processor=$2 compiler=$3 emulator=$4 folder=build/foreign-tests-$1-$2
  command -v "$compiler" >/dev/null && command -v "$emulator" >/dev/null || {
    say "   skipped: $system on $processor needs $compiler and $emulator"
    return
  }
  step "configuring the tests for $system on $processor" cmake -S . -B "$folder" -G Ninja -DCMAKE_BUILD_TYPE=Release -DCMAKE_SYSTEM_NAME="$system" \
    -DCMAKE_SYSTEM_PROCESSOR="$processor" -DCMAKE_CXX_COMPILER="$compiler" -DCMAKE_EXE_LINKER_FLAGS=-static -DCMAKE_CROSSCOMPILING_EMULATOR="$emulator"
  step "compiling the tests for $system on $processor" cmake --build "$folder"
  ctest --test-dir "$folder/native" --output-on-failure
}

# The same tests under the address and undefined behaviour sanitisers.
sanitized_tests() {
  ensure_compiler
  step "configuring the sanitised tests" cmake -S . -B build/sanitized-tests -G Ninja -DCMAKE_BUILD_TYPE=Release -DPIEPER_SANITIZE=ON
  step "compiling the sanitised tests" cmake --build build/sanitized-tests
  ctest --test-dir build/sanitized-tests/native --output-on-failure
}

# The bus on a real rclpy, in an environment of its own on top of this one: where rclpy is, every node would take it.
rclpy_tests() {
  local other=$root/build/rclpy
  "$python" -c 'import platform, sys; sys.exit((platform.system(), platform.machine()) != ("Linux", "x86_64") or sys.version_info >= (3, 14))' || {
    say "   skipped: rclpy comes as a package for Linux on x86-64 and Python 3.10 to 3.13"
    return
  }
  once rclpy "$(sha256sum <pyproject.toml) $identity" "installing rclpy" install_beside "$other" --group rclpy
  "$other/bin/python" -m pytest -q tests/ros/test_bus_contract.py tests/ros/test_rclpy_peer.py
}

# The page for those who come from other packages, with these packages; beside this environment, where they change nothing.
peers_tests() {
  local other=$root/build/peers
  "$python" -c 'import platform, sys; sys.exit((platform.system(), platform.machine()) != ("Linux", "x86_64") or not (3, 11) <= sys.version_info < (3, 14))' || {
    say "   skipped: all of these packages are to be had for Linux on x86-64 and Python 3.11 to 3.13"
    return
  }
  once peers "$(sha256sum <pyproject.toml) $identity" "installing the peers" install_beside "$other" --no-deps --group peers
  "$other/bin/python" -m pytest -q tests/migration
}

# install_beside FOLDER ARGUMENT...: an environment on top of this one, into which pip installs what the arguments say.
install_beside() {
  local folder='import sysconfig; print(sysconfig.get_path("purelib"))'
  rm -rf "$1"
  "$python" -m venv --without-pip "$1"
  printf 'import site; site.addsitedir("%s")\n' "$("$python" -c "$folder")" >"$("$1/bin/python" -c "$folder")/pieper.pth"
  "$python" -m pip --python "$1/bin/python" install "${@:2}"
}
