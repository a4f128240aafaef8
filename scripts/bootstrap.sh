#!/usr/bin/env bash
# Makes the virtual environment and fills it: bootstrap.sh run | dev | bench | newest
#   run    softcal with the `mesh` extra      (make demo)
#   dev    run + the other extras and the tools of the tests  (make test, make lint)
#   bench  dev + the peers of the benchmarks  (make bench)
#   newest dev in the newest versions, whatever is in constraints.txt  (make constraints)
# What the system lacks is installed where this runs as root; elsewhere one line says what to run.
set -euo pipefail
cd "$(dirname "$0")/.."
. scripts/system_packages.sh

level=${1:-run}
venv=.venv

find_python() {
  local candidate
  for candidate in ${PYTHON:-python3 python3.14 python3.13 python3.12 python3.11}; do
    if "$candidate" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; then
      echo "$candidate"
      return
    fi
  done
  return 1
}

make_environment() {
  local python version
  python=$(find_python) || stop "softcal needs Python 3.11 or newer; run: sudo apt-get install -y python3 (or name one: make PYTHON=python3.12 …)"
  if ! "$python" -c 'import ensurepip, venv' 2>/dev/null; then
    version=$("$python" -c 'import sys; print("%d.%d" % sys.version_info[:2])')
    need_packages "Python's venv module" "python$version-venv"
  fi
  "$python" -m venv --clear "$venv"
}

if ! "$venv/bin/python" -c 'import pip, sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; then
  make_environment
fi

pip() { "$venv/bin/python" -m pip --disable-pip-version-check --no-input "$@"; }

# Dependency groups need pip 25.1.
pip install --quiet --upgrade 'pip>=25.1'
tested() { pip install --quiet --constraint constraints.txt "$@"; }
case $level in
  run) tested --editable '.[all]' ;;
  dev) tested --editable '.[all]' --group dev ;;
  bench) tested --editable '.[all]' --group dev --group bench ;;
  newest) pip install --quiet --upgrade --upgrade-strategy eager --editable '.[all]' --group dev ;;
  *) stop "unknown level '$level'; allowed: run, dev, bench, newest" ;;
esac

# Each round may uncover the next: libraries first, then whether VTK can draw with them.
for _ in 1 2 3; do
  missing=$("$venv/bin/python" scripts/system_libraries.py)
  [ -n "$missing" ] || exit 0
  # shellcheck disable=SC2086  # a list of package names
  need_packages "system libraries of the Gmsh and VTK wheels" $missing
done
missing=$("$venv/bin/python" scripts/system_libraries.py)
[ -z "$missing" ] || echo "warning: still not usable after the installation: $missing" >&2
