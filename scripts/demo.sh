#!/usr/bin/env bash
# The main job on a fresh machine: make a virtual environment, install, localize over the embedded data set, print a table and the
# path of the results. Further words go to `panoloc run`.
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/environment.sh"

install "[report,plot]"
cd "$root"
exec "$venv/bin/panoloc" run configs/global.yaml --out "$root/results" "$@"
