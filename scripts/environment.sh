# Sourced by the other scripts: a virtual environment of our own with the package in it.
# PANOLOC_VENV: where it is (default: .venv in the repository). PYTHON: what it is made with (default: python3).

root="$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)"
venv="${PANOLOC_VENV:-$root/.venv}"
python="${PYTHON:-python3}"

# install EXTRAS: the package and what it needs, once for each state of pyproject.toml. EXTRAS: such as [test,plot], or nothing.
install() {
    local extras="$1"
    local stamp="$venv/installed$extras"
    if [[ -x "$venv/bin/python" && "$stamp" -nt "$root/pyproject.toml" && "$(cat "$stamp")" == "$root" ]]; then
        return
    fi
    if ! "$python" -c 'import sys; sys.exit(sys.version_info < (3, 11))'; then
        echo "$python is older than 3.11; name a newer one: PYTHON=python3.12 bash $0" >&2
        exit 2
    fi
    echo "installing into $venv" >&2
    [[ -x "$venv/bin/python" ]] || "$python" -m venv "$venv"
    PIP_DISABLE_PIP_VERSION_CHECK=1 PIP_ROOT_USER_ACTION=ignore \
        "$venv/bin/python" -m pip install --quiet --editable "$root$extras"
    echo "$root" >"$stamp"
}
