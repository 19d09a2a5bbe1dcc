# To be sourced. Debian and Ubuntu split what is one elsewhere: as root missing packages are installed, otherwise named.

say() { printf '%s\n' "$*" >&2; }

# apt_install PACKAGE...; where they are still missing it is false, and $why says what to do.
apt_install() {
    why="this machine lacks $* (on Debian and Ubuntu: apt-get install $*); install what is missing and run again"
    if [ "$(id -u)" -ne 0 ] || ! command -v apt-get >/dev/null; then
        return 1
    fi
    say "installing $* ..."
    local log
    log=$(mktemp)
    if ! { apt-get update && DEBIAN_FRONTEND=noninteractive apt-get install -y --no-install-recommends "$@"; } >"$log" 2>&1
    then
        cat "$log" >&2
        rm -f "$log"
        why="apt-get could not install $*"
        return 1
    fi
    rm -f "$log"
}
