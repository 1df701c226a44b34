#!/usr/bin/env bash
# The fast tests with the oldest supported dependencies on the oldest supported Python, and with the newest ones on every supported
# Python that is installed (3.11 to 3.14).
# Further words go to pytest: bash scripts/test_matrix.sh tests/robot. PYTHONS="python3.11 python3.13" names other interpreters.
set -uo pipefail
root="$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)"
work="$(mktemp -d)"
trap 'rm -rf "$work"' EXIT
export PANOLOC_CACHE_DIR="$work/cache" NUMBA_CACHE_DIR="$work/numba"
unset PYTHONPATH

python3 -m venv "$work/uv" && "$work/uv/bin/pip" install --quiet uv || exit 2
failed=0
for python in ${PYTHONS:-python3.11 python3.12 python3.13 python3.14}; do
    command -v "$python" >/dev/null || { echo "$python: not installed"; continue; }
    for resolution in lowest-direct highest; do
        [[ "$resolution" == highest || "$("$python" -c 'import sys; print(sys.version_info[:2])')" == "(3, 11)" ]] || continue
        venv="$work/$python-$resolution"
        "$python" -m venv "$venv"
        if ! "$work/uv/bin/uv" pip install --quiet --python "$venv/bin/python" --resolution "$resolution" "$root[test,plot,report]"; then
            echo "$python, $resolution: cannot be installed"
            failed=1
            continue
        fi
        # The package as it was installed, and none from the checkout.
        summary="$(cd "$root/tests" && "$venv/bin/python" -m pytest -c "$root/pyproject.toml" --rootdir "$root" -q -m "not slow" "${@:-$root/tests}" 2>&1 | tee "$work/log" | tail -1)"
        grep -E "^(FAILED|ERROR)" "$work/log"
        echo "$python, $resolution: $summary"
        [[ "$summary" == *failed* || "$summary" == *error* ]] && failed=1
    done
done
exit "$failed"
