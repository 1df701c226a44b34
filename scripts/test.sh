#!/usr/bin/env bash
# All tests in a virtual environment of their own. Further words go to pytest: bash scripts/test.sh -m "not slow" -x
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/environment.sh"

install "[test,plot,report,rerun,simulate]"
cd "$root"
exec "$venv/bin/python" -m pytest "$@"
