#!/usr/bin/env bash
# Make an environment for each peer, with the versions in requirements/: build/peers/NAME.
#
#     bash benchmarks/peers/environments.sh [pink mink placo tsid]
#
# TSID is compiled, which takes twelve minutes on a quiet core. One that fails does not stop the
# others; what is left of it is removed, and the exit code is 1.
set -uo pipefail
cd "$(dirname "$0")"
ROOT=$(cd ../.. && pwd)/build/peers
mkdir -p "$ROOT"
[ $# -gt 0 ] || set -- pink mink placo tsid

make_environment() {
    local pip="$ROOT/$1/bin/python -m pip install -qq"
    test -x "$ROOT/$1/bin/python" || "${PYTHON:-python3}" -m venv "$ROOT/$1" || return
    $pip -r "requirements/$1.txt" || return
    if [ "$1" = tsid ]; then
        # Against this environment: isolated, it would be built for newer libraries than it runs with.
        PATH=$ROOT/tsid/bin:$PATH CMEEL_CMAKE_ARGS=-DBUILD_TESTING=OFF \
            $pip --no-build-isolation --no-binary libtsid libtsid==1.9.0 || return
        $pip --no-deps tsid==1.9.0
    fi
}

code=0
for name in "$@"; do
    echo "$name"
    was_there=$(test -d "$ROOT/$name" && echo yes)
    if ! make_environment "$name"; then
        echo "$name: could not be made" >&2
        code=1
        [ "$was_there" ] || rm -rf "${ROOT:?}/$name"
    fi
done
exit $code
