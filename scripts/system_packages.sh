# Sourced by other scripts: installs Debian packages as root, or says in one line what to run.

stop() {
  echo "$*" >&2
  exit 1
}

# need_packages WHAT PACKAGE…
need_packages() {
  local what=$1
  shift
  if [ "$(id -u)" -ne 0 ] || ! command -v apt-get >/dev/null; then
    stop "$what: missing; run: sudo apt-get update && sudo apt-get install -y $*"
  fi
  echo "$what: missing; installing $*" >&2
  export DEBIAN_FRONTEND=noninteractive
  apt-get update -qq >&2
  apt-get install -y -qq --no-install-recommends "$@" </dev/null >&2
}
