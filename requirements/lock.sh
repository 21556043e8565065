#!/bin/sh
# Renew the locks: one resolution for all, cut to what each machine installs. Universal: every file of every
# version is hashed, so x86-64 and aarch64 install from the same lock.
set -eu
uv=$1
common="--universal --python-version 3.11 --generate-hashes --no-header --no-annotate
        --no-emit-index-url --no-emit-find-links --no-strip-extras --quiet"
cd "$(dirname "$0")/.."
lock() {
    # shellcheck disable=SC2086
    "$uv" pip compile pyproject.toml $common --no-emit-package palpate "$@"
}
lock --all-extras --upgrade requirements/build.in requirements/kernels.in -o requirements/full.lock
lock -c requirements/full.lock --extra host --extra train --extra twin --extra record --extra view --extra dev -o requirements/dev.lock
lock -c requirements/full.lock --extra host --extra train requirements/build.in -o requirements/host.lock
lock -c requirements/full.lock --extra host --extra onnx --extra test -o requirements/guest.lock
lock -c requirements/full.lock --extra onnx requirements/build.in -o requirements/edge.lock
# shellcheck disable=SC2086
"$uv" pip compile requirements/kernels.in $common -c requirements/full.lock -o requirements/kernels.lock
# shellcheck disable=SC2086
"$uv" pip compile requirements/firmware.in $common -c requirements/full.lock -o requirements/firmware.lock
# shellcheck disable=SC2086
"$uv" pip compile requirements/deploy.in $common -o requirements/deploy.lock
# shellcheck disable=SC2086
"$uv" pip compile requirements/ros.in $common -c requirements/full.lock -o requirements/ros.lock
# shellcheck disable=SC2086
"$uv" pip compile requirements/dcfgen.in $common -o requirements/dcfgen.lock
# LeRobot: an environment of its own, without any of palpate's packages.
# shellcheck disable=SC2086
"$uv" pip compile requirements/lerobot.in $(echo "$common" | sed 's/3\.11/3.12/') -o requirements/lerobot.lock
