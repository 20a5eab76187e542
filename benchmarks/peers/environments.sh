#!/usr/bin/env bash
# Make an environment for each peer, with the versions in requirements/: build/peers/NAME.
#
#     bash benchmarks/peers/environments.sh [pink mink placo tsid]
#
# TSID is compiled, which takes twelve minutes on a quiet core.
set -euo pipefail
cd "$(dirname "$0")"
ROOT=$(cd ../.. && pwd)/build/peers
mkdir -p "$ROOT"
[ $# -gt 0 ] || set -- pink mink placo tsid
for name in "$@"; do
    echo "$name"
    test -x "$ROOT/$name/bin/python" || "${PYTHON:-python3}" -m venv "$ROOT/$name"
    "$ROOT/$name/bin/python" -m pip install -qq -r "requirements/$name.txt"
    if [ "$name" = tsid ]; then
        # Against this environment: isolated, it would be built for newer libraries than it runs with.
        PATH=$ROOT/tsid/bin:$PATH CMEEL_CMAKE_ARGS=-DBUILD_TESTING=OFF \
            "$ROOT/tsid/bin/python" -m pip install -qq --no-build-isolation --no-binary libtsid libtsid==1.9.0
        "$ROOT/tsid/bin/python" -m pip install -qq --no-deps tsid==1.9.0
    fi
done
