"""Which LLVM library Mitsuba may use. One that does not fit the processor ends the whole process, so each is tried in a child."""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import platform
import re
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path

from panoloc_mcl.robot.errors import OutputError
from panoloc_mcl.robot.files import cache_folder, write_atomically

VARIABLE = "DRJIT_LIBLLVM_PATH"
INSTALL = f"install LLVM 17 or newer (Debian: libllvm19), or set {VARIABLE}"

_TRIAL = "from panoloc_mcl.laboratory.simulation.engine.trial import trial; trial()"
_PATIENCE_S = 180.0
# Where systems put it: Debian and Ubuntu, Fedora, others, Homebrew, MacPorts.
_FOLDERS = (
    "/usr/lib/*-linux-gnu",
    "/usr/lib/llvm-*/lib",
    "/usr/lib64",
    "/usr/lib64/llvm*/lib",
    "/usr/lib",
    "/usr/local/lib",
    "/opt/homebrew/opt/llvm*/lib",
    "/usr/local/opt/llvm*/lib",
    "/opt/local/libexec/llvm-*/lib",
    "C:/Program Files/LLVM/bin",
)
_NAMES = ("libLLVM*.so*", "libLLVM*.dylib", "LLVM-C.dll")


@dataclass(frozen=True)
class Choice:
    """What was found.

    Parameters
    ----------
    library : Path or None
        One that works.
    remark : str
        A line for the user: why it is not the library that was asked for, or why there is none. Empty if there is nothing to say.
    """

    library: Path | None
    remark: str


def choose() -> Choice:
    """The library of ``DRJIT_LIBLLVM_PATH`` if it works, else the newest that does.

    The first time, every library in question is tried in a process of its own, some seconds each; the answer is kept in the
    cache, under all it depends on.
    """
    asked = os.environ.get(VARIABLE)
    tried: list[str] = []
    for library in ([Path(asked).expanduser()] if asked else []) + candidates():
        wrong = _remembered(library)
        if not wrong:
            remark = f"{VARIABLE} = {tried[0]}; using {library} instead" if asked and tried else ""
            return Choice(library, remark)
        tried.append(f"{library}: {wrong}")
    why = f"no LLVM library that works here ({'; '.join(tried)})" if tried else "no LLVM library found"
    return Choice(None, f"{why}; {INSTALL}")


def candidates() -> list[Path]:
    """LLVM libraries of this machine, newest first, each once."""
    found: dict[Path, Path] = {}
    for folder in (f"{sys.prefix}/lib", *_FOLDERS):
        for name in _NAMES:
            for path in _glob(f"{folder}/{name}"):
                found.setdefault(path.resolve(), path)
    return [path.resolve() for path in sorted(found, key=lambda path: (_version(path), str(path)), reverse=True)]


def _glob(pattern: str) -> Iterator[Path]:
    root = Path(Path(pattern).anchor)
    try:
        yield from (path for path in root.glob(str(Path(pattern).relative_to(root))) if path.is_file())
    except OSError:
        return


def _version(path: Path) -> tuple[int, ...]:
    """The numbers in its name, or in that of its folder: libLLVM-16.so.1, libLLVM.so.19.1, llvm-17/lib/libLLVM.so."""
    for text in (path.name, path.parent.parent.name):
        numbers = re.findall(r"\d+", text)
        if numbers:
            return tuple(int(number) for number in numbers)
    return ()


def try_library(library: Path) -> str:
    """Render a very small scene with it, in a process of its own.

    Returns
    -------
    str
        Empty if it works; else what happened, in a few words.
    """
    if not library.is_file():
        return "no such file"
    with tempfile.TemporaryDirectory(prefix="panoloc_llvm_") as folder:
        # DrJit keeps compiled programs in the home folder: in an empty one the library has to do the work. A core goes there, too.
        home = dict.fromkeys(("HOME", "LOCALAPPDATA", "TEMP"), folder) if os.name == "nt" else {"HOME": folder}
        environment = {**os.environ, **home, VARIABLE: str(library), "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
        try:
            child = subprocess.run(
                [sys.executable, "-c", _TRIAL],
                env=environment,
                cwd=folder,
                capture_output=True,
                text=True,
                errors="replace",
                timeout=_PATIENCE_S,
                check=False,
            )
        except subprocess.TimeoutExpired:
            return f"does not finish in {_PATIENCE_S:.0f} s"
        except OSError as error:
            return f"cannot be tried ({error.strerror})"
    return "" if child.returncode == 0 else _what_happened(child.returncode, child.stderr)


def _what_happened(code: int, said: str) -> str:
    lines = [line.strip() for line in said.splitlines() if line.strip()]
    for line in lines:
        if line.startswith("LLVM ERROR"):
            # Addresses of nodes tell nothing.
            return re.sub(r"\s+", " ", re.sub(r"0x[0-9a-f]+:? ?", "", line))[:90].rstrip(" ,")
    if "LLVM shared library" in said:
        return "DrJit cannot load it, or it is too old"
    if code < 0:
        try:
            return f"ends the process with {signal.Signals(-code).name}"
        except ValueError:
            pass
    return lines[-1][:90] if lines else f"ends the process with code {code}"


def _remembered(library: Path) -> str:
    """As `try_library`, but asked once only for a library, a version of Mitsuba and a processor."""
    path, key = cache_folder() / "llvm.json", _key(library)
    known = _read(path)
    if key not in known:
        known[key] = try_library(library)
        # A cache that cannot be written costs the trial the next time.
        with contextlib.suppress(OutputError):
            write_atomically(path, json.dumps(known, indent=1))
    return known[key]


def _read(path: Path) -> dict[str, str]:
    try:
        known = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return {str(key): str(value) for key, value in known.items()} if isinstance(known, dict) else {}


def _key(library: Path) -> str:
    try:
        real = library.resolve()
        state = real.stat()
        what = [str(real), state.st_size, state.st_mtime_ns]
    except OSError:
        what = [str(library)]
    said = [*what, metadata.version("mitsuba"), metadata.version("drjit"), platform.machine(), _processor()]
    return hashlib.sha256(json.dumps(said).encode()).hexdigest()[:24]


def _processor() -> str:
    """Its name and, where they can be read, its instruction sets."""
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return platform.processor()
    return "\n".join(line for line in text.split("\n\n")[0].splitlines() if re.match(r"(model name|flags|Features|CPU)", line))
