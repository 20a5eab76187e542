#!/usr/bin/env bash
# Make an environment for each peer, with the versions in requirements/: build/peers/NAME.
#
#     bash benchmarks/peers/environments.sh [pink mink placo tsid]
set -euo pipefail
cd "$(dirname "$0")"
ROOT=../../build/peers
mkdir -p $ROOT
export CMEEL_CMAKE_ARGS=-DBUILD_TESTING=OFF  # TSID's tests take longer than TSID
[ $# -gt 0 ] || set -- pink mink placo tsid
for name in "$@"; do
    echo "$name"
    test -x $ROOT/$name/bin/python || "${PYTHON:-python3}" -m venv $ROOT/$name
    # As constraints, the versions also hold where TSID is built.
    PIP_CONSTRAINT=requirements/$name.txt $ROOT/$name/bin/python -m pip install -qq -r requirements/$name.txt
done
